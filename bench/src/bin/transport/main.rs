//! Our hop between two processes beside its floors, in turn in one run: `transport --json`.
//!
//! For each topic: raw iceoryx2 with the same payload, queue settings and wake-up mode, a futex wake, a Unix socket that
//! copies the bytes, and one copy within a process. On a machine with other work, run it as
//! `chrt -f 50 target/release/transport` and read ratios, not microseconds.

mod report;

use std::time::Duration;

use anyhow::{Result, bail};
use clap::{Parser, ValueEnum};
use mluc_transport::{Load, Payload, Settings, Wake, Way, measure, serve_peer};

use report::Report;

#[derive(Parser)]
struct Arguments {
    /// Messages each way, for each topic. 36 MB messages: a quarter as many.
    #[arg(long, default_value_t = 2000)]
    rounds: usize,
    /// Between two messages, us: long enough that the receiver sleeps.
    #[arg(long, default_value_t = 1000)]
    pause_us: u64,
    /// How raw iceoryx2 waits; our stages sleep.
    #[arg(long, value_enum, default_value_t)]
    wake: WakeName,
    /// Cores of sender and receiver, `0,1`; else the kernel decides.
    #[arg(long, value_delimiter = ',', num_args = 2)]
    cores: Option<Vec<usize>>,
    /// These alone, of `points`, `features`, `detections`, `objects`.
    #[arg(long, value_delimiter = ',')]
    topics: Vec<String>,
    /// One JSON object on stdout.
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, Debug, Default, ValueEnum)]
enum WakeName {
    /// It sleeps until an event wakes it, as our stages do.
    #[default]
    Event,
    /// It looks all the time.
    Poll,
}

fn main() -> Result<()> {
    if serve_peer()? {
        return Ok(());
    }
    let arguments = Arguments::parse();
    if let Some(topic) = arguments
        .topics
        .iter()
        .find(|topic| Payload::from_name(topic).is_none())
    {
        bail!("topic {topic}: points, features, detections or objects expected");
    }
    let mut measured = vec![];
    for load in [
        Load::POINTS,
        Load::FEATURES,
        Load::DETECTIONS,
        Load::OBJECTS,
    ] {
        let name = load.payload.name();
        if !arguments.topics.is_empty() && !arguments.topics.iter().any(|topic| topic == name) {
            continue;
        }
        let rounds = match load {
            Load::FEATURES => arguments.rounds.div_ceil(4),
            _ => arguments.rounds,
        };
        let settings = Settings {
            pause: Duration::from_micros(arguments.pause_us),
            wake: match arguments.wake {
                WakeName::Event => Wake::Event,
                WakeName::Poll => Wake::Poll,
            },
            cores: match arguments.cores.as_deref() {
                Some(&[sender, receiver]) => Some([sender, receiver]),
                _ => None,
            },
            ..Settings::new(load, rounds)
        };
        measured.push((load.payload, measure(&settings, &Way::ALL)?));
    }
    let report = Report::of(&measured);
    match arguments.json {
        true => println!("{}", serde_json::to_string(&report)?),
        false => report.print(),
    }
    Ok(())
}
