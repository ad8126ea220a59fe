//! What was measured, as JSON.

use mluc_geometry::quantile_of;
use rustix::time::{ClockId, Timespec, clock_gettime};
use serde_json::{Value, json};
use std::time::Instant;

/// The parts of the network. `sparse3d` includes the rulebooks; `dense2d` includes folding the height and writing feature rows;
/// `head` is everything after the backbone (1x1 convolutions, decoding, suppression, scores).
pub(crate) const PARTS: [&str; 4] = ["voxelize", "sparse3d", "dense2d", "head"];

#[derive(Default)]
pub(crate) struct Frame {
    steps: Vec<Step>,
    pub(crate) total_ms: f64,
}

struct Step {
    part: &'static str,
    name: String,
    ms: f64,
    /// CPU time of all threads.
    cpu_ms: f64,
}

/// When a step began.
pub(crate) struct Start(Instant, Timespec);

impl Start {
    pub(crate) fn now() -> Start {
        Start(Instant::now(), clock_gettime(ClockId::ProcessCPUTime))
    }

    pub(crate) fn elapsed_ms(&self) -> f64 {
        self.0.elapsed().as_secs_f64() * 1e3
    }

    fn cpu_ms(&self) -> f64 {
        let since = clock_gettime(ClockId::ProcessCPUTime) - self.1;
        since.tv_sec as f64 * 1e3 + since.tv_nsec as f64 / 1e6
    }
}

impl Frame {
    pub(crate) fn add(&mut self, part: &'static str, step: &str, last: &mut Start) {
        self.steps.push(Step {
            part,
            name: step.into(),
            ms: last.elapsed_ms(),
            cpu_ms: last.cpu_ms(),
        });
        *last = Start::now();
    }

    fn part_ms(&self, part: &str) -> f64 {
        self.steps.iter().filter(|step| step.part == part).map(|step| step.ms).sum()
    }
}

/// The timed frames of all scans.
#[derive(Default)]
pub(crate) struct Record {
    pub(crate) frames: Vec<Frame>,
    /// Time of each scan's first frame after the model was loaded.
    pub(crate) first_ms: Vec<f64>,
}

impl Record {
    pub(crate) fn json(&self) -> Value {
        json!({
            "ms_p50": self.milliseconds(0.5),
            "ms_p99": self.milliseconds(0.99),
            "frames": self.frames.len(),
            "steps": self.steps().map(|(place, name)| json!({
                "step": name,
                "ms_min": rounded(self.quantile(0.0, |frame| frame.steps[place].ms)),
                "ms_p50": rounded(self.quantile(0.5, |frame| frame.steps[place].ms)),
                "ms_p99": rounded(self.quantile(0.99, |frame| frame.steps[place].ms)),
                "cpu_ms_p50": rounded(self.quantile(0.5, |frame| frame.steps[place].cpu_ms)),
            })).collect::<Vec<_>>(),
            "first_ms": rounded(self.first_ms.iter().copied().fold(0.0, f64::max)),
        })
    }

    fn milliseconds(&self, q: f64) -> Value {
        let part = |part| (part, self.quantile(q, |frame| frame.part_ms(part)));
        let total = self.quantile(q, |frame| frame.total_ms);
        let parts = PARTS.into_iter().map(part).chain([("total", total)]);
        parts.map(|(name, ms)| (name, rounded(ms))).collect()
    }

    fn quantile(&self, q: f64, value: impl Fn(&Frame) -> f64) -> f64 {
        quantile_of(self.frames.iter().map(value).collect(), q).unwrap_or(0.0)
    }

    /// Index and name of each step, the same in every frame.
    fn steps(&self) -> impl Iterator<Item = (usize, &str)> {
        let steps = self.frames.first().map_or(&[][..], |frame| &frame.steps);
        steps.iter().map(|step| step.name.as_str()).enumerate()
    }
}

fn rounded(value: f64) -> Value {
    json!((value * 1e4).round() / 1e4)
}
