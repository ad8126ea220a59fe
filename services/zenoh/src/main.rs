//! The program `mluc-zenoh`, which `mluc zenoh` starts. It sends objects and states of a running pipeline to other computers. Nothing in the
//! pipeline waits for it, and it waits for no network: a message that a link does not accept is dropped.

use anyhow::anyhow;
use clap::{ArgGroup, Parser};
use mluc_runtime::{Instance, log_to_stderr};
use mluc_view::{Follower, TOPICS, yield_to_stages};
use serde_json::json;
use std::{path::PathBuf, process::ExitCode, time::Duration, time::Instant};
use zenoh::{Config, Wait, bytes::Encoding, qos::CongestionControl, qos::Priority};

/// The keys: index in a moment's messages, name, encoding. The clouds are last.
const KEYS: [(usize, &str, Encoding); 5] = [
    (TOPICS - 1, "frame", Encoding::APPLICATION_JSON),
    (1, "objects", Encoding::APPLICATION_CDR),
    (3, "diagnostics", Encoding::APPLICATION_CDR),
    (4, "tf", Encoding::APPLICATION_CDR),
    (0, "points", Encoding::APPLICATION_CDR),
];

/// If there is no connection after this time, a warning is logged.
const REACHED_WITHIN: Duration = Duration::from_secs(5);

/// Publish objects and states of a running pipeline over zenoh, until Ctrl-C.
#[derive(Parser)]
#[command(name = "mluc zenoh", bin_name = "mluc zenoh", version)]
#[command(group = ArgGroup::new("link").required(true).multiple(true).args(["connect", "listen", "config"]))]
struct Cli {
    /// Name of the pipeline, which may be started later [default: MLUC_INSTANCE, else `default`].
    #[arg(long, value_parser = Instance::new)]
    instance: Option<Instance>,
    /// What the keys begin with [default: mluc/INSTANCE].
    #[arg(long, value_name = "KEY")]
    prefix: Option<String>,
    /// A router or peer, tcp/HOST:7447; it may come and go.
    #[arg(long, value_name = "LOCATOR")]
    connect: Vec<String>,
    /// Where peers may connect, tcp/127.0.0.1:7447 [default: nowhere].
    #[arg(long, value_name = "LOCATOR")]
    listen: Vec<String>,
    /// Configuration file of zenoh itself (JSON5): access control, multicast. --connect and --listen replace its endpoints.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Publish the clouds too: 16 bytes per point and 4 for its object: 2.4 MB per scan of 120,000 points.
    #[arg(long)]
    points: bool,
}

impl Cli {
    /// Configuration of zenoh. Without a file: a peer that does not listen, does not scout, and reconnects by itself.
    fn zenoh(&self) -> zenoh::Result<Config> {
        let mut config = match &self.config {
            Some(path) => Config::from_file(path)?,
            None => Config::from_json5(
                r#"{mode: "peer", listen: {endpoints: []}, scouting: {multicast: {enabled: false}},
                    connect: {timeout_ms: -1, exit_on_failure: false}}"#,
            )?,
        };
        for (key, locators) in [("connect", &self.connect), ("listen", &self.listen)] {
            if !locators.is_empty() {
                config.insert_json5(&format!("{key}/endpoints"), &json!(locators).to_string())?;
            }
        }
        Ok(config)
    }
}

/// Adds what failed to an error of zenoh; zenoh's errors have no types of their own.
fn told<T>(what: &str, done: zenoh::Result<T>) -> anyhow::Result<T> {
    done.map_err(|error| anyhow!("{what}: {error}"))
}

fn main() -> ExitCode {
    let cli = Cli::parse();
    let filter = "info,zenoh=warn,zenoh_transport=error,zenoh_link=error";
    log_to_stderr("zenoh", filter);
    run(&cli).map_or_else(
        |error| {
            tracing::error!("{error:#}");
            ExitCode::FAILURE
        },
        |()| ExitCode::SUCCESS,
    )
}

fn run(cli: &Cli) -> anyhow::Result<()> {
    let config = told("--connect, --listen, --config", cli.zenoh())?;
    yield_to_stages()?;
    // Opening may never return; a signal still ends the program.
    let session = told("opening a zenoh session", zenoh::open(config).wait())?;
    let mut follower = Follower::open(cli.instance.clone())?;
    let default = format!("mluc/{}", follower.shell.instance().name());
    let prefix = cli.prefix.as_ref().unwrap_or(&default);
    let mut publishers = vec![];
    for (place, name, encoding) in &KEYS[..KEYS.len() - usize::from(!cli.points)] {
        let is_cloud = *place == 0;
        let priority = [Priority::RealTime, Priority::DataLow][usize::from(is_cloud)];
        let publisher = session
            .declare_publisher(format!("{prefix}/{name}"))
            .encoding(encoding.clone())
            .congestion_control(CongestionControl::Drop)
            .priority(priority)
            .express(!is_cloud);
        publishers.push((*place, told("--prefix", publisher.wait())?));
    }
    tracing::info!("publishing {prefix}/frame, objects, diagnostics, tf; Ctrl-C ends it");
    let (begun, mut is_alone) = (Instant::now(), true);
    while let Some(mut moment) = follower.next(|| true)? {
        if is_alone && begun.elapsed() > REACHED_WITHIN {
            let info = session.info();
            let mut reached = info.peers_zid().wait().chain(info.routers_zid().wait());
            if reached.next().is_none() {
                tracing::warn!(
                    "no router and no peer is connected yet: with --connect, check the locator and whether something listens there"
                );
            }
            is_alone = false;
        }
        for (place, publisher) in &publishers {
            if let Some(message) = moment.messages[*place].take() {
                told("publishing", publisher.put(message).wait())?;
            }
        }
    }
    let missed = follower.shell.health.frames_dropped;
    tracing::info!(missed, "ended");
    told("closing the zenoh session", session.close().wait())
}
