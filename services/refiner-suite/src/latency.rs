//! What a hop into a refiner and out of it costs: two programs side by side, frame by frame in turns.

use std::time::{Duration, Instant};

use anyhow::Context;
use hdrhistogram::Histogram;
use mluc_ipc_types::Stage;
use mluc_runtime::Instance;
use serde::Serialize;

use crate::player::Player;
use crate::program::Program;
use crate::scene::usual;
use crate::session::Options;

/// Frames before the first that counts.
const WARM_UP: usize = 20;
/// Longest time told apart, ns.
const LONGEST_NS: u64 = 10_000_000_000;

/// Of one quantity, us.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Percentiles {
    /// Median.
    pub p50_us: f64,
    /// 99th percentile.
    pub p99_us: f64,
    /// Largest.
    pub max_us: f64,
}

/// Of one program.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct HopTimes {
    /// Which program.
    pub program: String,
    /// From the head's publication to the refiner's reception.
    pub hop_in: Percentiles,
    /// From its reception to its publication.
    pub run: Percentiles,
    /// From its publication to the reception behind it.
    pub hop_out: Percentiles,
}

/// Two programs side by side.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LatencyReport {
    /// Frames measured of each.
    pub frames: usize,
    /// What the other is compared with.
    pub reference: HopTimes,
    /// The program.
    pub program: HopTimes,
    /// Program minus reference, p50 of the hop in, us.
    pub extra_in_p50_us: f64,
    /// The same of the hop out.
    pub extra_out_p50_us: f64,
}

struct Lane<'a> {
    // The program ends before the ports do.
    program: Program,
    player: Player,
    options: &'a Options,
    times: [Histogram<u64>; 3],
}

/// Sends `frames` frames to each, one after the other in turns, with a pause of `period` before each.
pub fn compare_latency(
    reference: &Options,
    program: &Options,
    frames: usize,
    period: Duration,
) -> anyhow::Result<LatencyReport> {
    let mut lanes = [Lane::start(reference, 0)?, Lane::start(program, 1)?];
    for number in 0..WARM_UP + frames {
        for lane in &mut lanes {
            std::thread::sleep(period);
            lane.frame(number >= WARM_UP)
                .with_context(|| lane.options.title.clone())?;
        }
    }
    let [reference, program] = lanes.map(|lane| lane.result());
    Ok(LatencyReport {
        frames,
        extra_in_p50_us: program.hop_in.p50_us - reference.hop_in.p50_us,
        extra_out_p50_us: program.hop_out.p50_us - reference.hop_out.p50_us,
        reference,
        program,
    })
}

impl<'a> Lane<'a> {
    fn start(options: &'a Options, number: u32) -> anyhow::Result<Lane<'a>> {
        let instance = Instance::new(&format!("hop-{number}-{}", std::process::id()))?;
        let mut player = Player::new(&instance, options.fingerprint, options.shutdown.clone())?;
        let command = (options.command)(instance.name());
        let since_ns = player.forget_heartbeats()?;
        let mut program = Program::start(&command, &options.environment(&instance))?;
        let begun = Instant::now();
        while player.health_since(since_ns, |_| true)?.is_none() {
            player.check_running()?;
            std::thread::sleep(Duration::from_millis(5));
            anyhow::ensure!(
                program.ended().is_none() && begun.elapsed() < options.patience,
                "{} did not start: {}",
                options.title,
                program.last_words()
            );
        }
        let empty = || Histogram::new_with_bounds(1, LONGEST_NS, 3);
        Ok(Lane {
            program,
            player,
            options,
            times: [empty()?, empty()?, empty()?],
        })
    }

    fn frame(&mut self, counts: bool) -> anyhow::Result<()> {
        let (points, detections) = usual();
        let frame = self.player.frame(points, detections);
        let sent = self.player.send(&frame)?;
        let begun = Instant::now();
        let answer = loop {
            match self.player.take_answer()? {
                Some(answer) if answer.header.sequence == sent.header.sequence => break answer,
                Some(_) => continue,
                None => self.player.wait(),
            }
            self.player.check_running()?;
            anyhow::ensure!(
                self.program.ended().is_none() && begun.elapsed() < self.options.patience,
                "no answer to frame {}: {}",
                sent.header.sequence,
                self.program.last_words()
            );
        };
        let own = answer.header.stages[Stage::Refiner as usize];
        let head_ns = sent.header.stages[Stage::Head as usize].published_ns;
        let spans = [
            (head_ns, own.received_ns),
            (own.received_ns, own.published_ns),
            (own.published_ns, answer.received_ns),
        ];
        if counts {
            for (times, (from, to)) in self.times.iter_mut().zip(spans) {
                times.saturating_record(to.saturating_sub(from).max(1));
            }
        }
        Ok(())
    }

    fn result(self) -> HopTimes {
        let [hop_in, run, hop_out] = self.times.each_ref().map(|times| Percentiles {
            p50_us: times.value_at_quantile(0.50) as f64 * 1e-3,
            p99_us: times.value_at_quantile(0.99) as f64 * 1e-3,
            max_us: times.max() as f64 * 1e-3,
        });
        HopTimes {
            program: self.options.title.clone(),
            hop_in,
            run,
            hop_out,
        }
    }
}

impl LatencyReport {
    /// The table.
    pub fn text(&self) -> String {
        let mut text = format!(
            "{} frames each, in turns; us           p50        p99        max\n",
            self.frames
        );
        for times in [&self.reference, &self.program] {
            text += &format!("{}\n", times.program);
            for (name, p) in [
                ("head published -> received", times.hop_in),
                ("received -> published", times.run),
                ("published -> received behind", times.hop_out),
            ] {
                text += &format!(
                    "  {name:32}{:10.1} {:10.1} {:10.1}\n",
                    p.p50_us, p.p99_us, p.max_us
                );
            }
        }
        text + &format!(
            "extra a hop at p50: in {:+.1} us, out {:+.1} us\n",
            self.extra_in_p50_us, self.extra_out_p50_us
        )
    }
}
