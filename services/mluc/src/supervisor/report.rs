//! The tables at the end of a run: latency and frames by stage.

use hdrhistogram::Histogram;
use mluc_gateway::lines::{latency_us, stage_times};
use mluc_ipc_types::{FrameHeader, Stage, Status};
use smart_default::SmartDefault;

/// Upper bound of the histograms, us: ten minutes.
const LONGEST_US: u64 = 600_000_000;

/// Latencies of all frames, us.
#[derive(Debug, SmartDefault)]
pub(crate) struct Latencies {
    #[default(std::array::from_fn(|_| empty()))]
    queue: [Histogram<u64>; 4],
    #[default(std::array::from_fn(|_| empty()))]
    run: [Histogram<u64>; 4],
    #[default(empty())]
    total: Histogram<u64>,
}

/// A histogram without times; it keeps three digits of each time.
fn empty() -> Histogram<u64> {
    Histogram::new_with_bounds(1, LONGEST_US, 3).expect("constant bounds that fit")
}

/// The table of a run's frames by stage: in = out + dropped in every row.
pub(crate) fn hops(status: &Status) -> String {
    let mut text = String::from("frames               in      out  dropped     late\n");
    let mut row = |name: &str, [taken, out, late]: [u64; 3]| {
        let dropped = taken.saturating_sub(out);
        text += &format!("{name:14}{taken:9}{out:9}{dropped:9}{late:9}\n");
    };
    for stage in Stage::ALL {
        row(stage.name(), status.hop(stage));
    }
    let all = [status.frames_in, status.frames_out, status.frames_late];
    row("end to end", all);
    text
}

impl Latencies {
    pub(super) fn record(&mut self, header: &FrameHeader) {
        for stage in Stage::ALL {
            let times = stage_times(header, stage);
            self.queue[stage as usize].saturating_record(times.queue_us.max(1));
            self.run[stage as usize].saturating_record(times.run_us.max(1));
        }
        self.total.saturating_record(latency_us(header).max(1));
    }

    /// The table, in ms; it includes the first frame.
    pub(crate) fn table(&self) -> String {
        let mut text = String::from("latency, ms        p50      p99      max\n");
        let mut row = |name: &str, us: &Histogram<u64>| {
            let [p50, p99] = [0.50, 0.99].map(|q| us.value_at_quantile(q));
            let [p50, p99, max] = [p50, p99, us.max()].map(|us| us as f64 / 1000.0);
            text += &format!("{name:14}{p50:9.2}{p99:9.2}{max:9.2}\n");
        };
        for stage in Stage::ALL {
            row(stage.name(), &self.run[stage as usize]);
            row("  queue before", &self.queue[stage as usize]);
        }
        row("end to end", &self.total);
        text
    }
}
