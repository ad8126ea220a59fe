//! What was measured, as JSON.

use mluc_backbone::Precision;
use mluc_geometry::quantile_of;
use mluc_kernels::{Bf16, Level, spin};
use rustix::time::{ClockId, Timespec, clock_gettime};
use serde_json::{Value, json};
use std::{collections::BTreeMap, time::Instant};

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
    /// Sites by step, summed over the scans.
    sites: BTreeMap<String, f64>,
    /// Operations by part, summed over the scans: by the layers' definition, and as multiplied.
    operations: BTreeMap<&'static str, [f64; 2]>,
}

impl Record {
    /// Counts a step of a scan.
    pub(crate) fn count(&mut self, part: &'static str, step: (&str, usize), operations: [f64; 2]) {
        let (name, sites) = step;
        let sums = self.operations.entry(part).or_default();
        *sums = [0, 1].map(|kind| sums[kind] + operations[kind]);
        if !["ground", "rulebooks"].contains(&name) {
            *self.sites.entry(name.into()).or_default() += sites as f64;
        }
    }

    /// Billions of operations by part, mean over the scans.
    fn gflop(&self, kind: usize) -> Vec<(&'static str, f64)> {
        let scale = 1e-9 / self.first_ms.len() as f64;
        let parts = self.operations.iter().filter(|(part, _)| PARTS[1..].contains(part));
        parts.map(|(part, sums)| (*part, scale * sums[kind])).collect()
    }

    /// `peak_gflops`: see [`peak_gflops`].
    pub(crate) fn json(&self, peak_gflops: f64) -> Value {
        let scans = self.first_ms.len() as f64;
        let site =
            |(name, sum): (&String, &f64)| (name.clone(), json!((sum / scans).round() as u64));
        let gflop = |kind: usize| {
            let parts = self.gflop(kind);
            let total = parts.iter().map(|(_, gflop)| gflop).sum();
            let all = parts.into_iter().chain([("total", total)]);
            all.map(|(part, gflop)| (part, rounded(gflop))).collect::<Value>()
        };
        // Most of the head's time is not products; voxelization has none.
        let parts = self.gflop(1).into_iter().filter(|(part, _)| PARTS[1..3].contains(part));
        let share = parts.map(|(part, gflop)| {
            let seconds = 1e-3 * self.quantile(0.5, |frame| frame.part_ms(part));
            (part, rounded(gflop / seconds / peak_gflops))
        });
        json!({
            "sites": self.sites.iter().map(site).collect::<Value>(),
            "gflop": gflop(0),
            "gflop_executed": gflop(1),
            "peak_share": share.collect::<Value>(),
            "peak_gflops": peak_gflops.round(),
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

/// Operations of multiply-adds that use only registers (int8: of integers), of one thread times `threads`, 1e9 per second.
pub(crate) fn peak_gflops(precision: Precision, threads: usize) -> f64 {
    /// A try takes some milliseconds.
    const STEPS: usize = 500_000;
    const TRIES: usize = 15;
    let spin = match precision {
        Precision::Bf16 => spin::<Bf16>,
        Precision::Int8 if Level::best().widens_bytes() => spin::<i16>,
        Precision::Int8 => spin::<u8>,
        _ => spin::<f32>,
    };
    let gflops = |_| {
        let start = Start::now();
        let operations = spin(Level::best(), STEPS);
        1e-6 * operations / start.elapsed_ms()
    };
    threads as f64 * (0..TRIES).map(gflops).fold(0.0, f64::max)
}
