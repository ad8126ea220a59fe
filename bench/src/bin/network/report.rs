//! What was measured, as a table or as JSON.

use std::collections::BTreeMap;
use std::time::Instant;

use mluc_backbone::{Precision, Step};
use mluc_geometry::quantile_of;
use mluc_kernels::{Bf16, Level, spin};
use serde_json::{Value, json};

/// The parts of the network: rulebooks are in `sparse3d`, the fold of the height and the writing of feature rows in
/// `dense2d`, all but the backbone (1x1 convolutions, decoding, suppression, scores) in `head`.
pub(crate) const PARTS: [&str; 4] = ["voxelize", "sparse3d", "dense2d", "head"];

#[derive(Default)]
pub(crate) struct Frame {
    steps: Vec<(&'static str, String, f64)>,
    pub(crate) total_ms: f64,
}

impl Frame {
    pub(crate) fn add(&mut self, part: &'static str, step: &str, last: &mut Instant) {
        let ms = last.elapsed().as_secs_f64() * 1e3;
        self.steps.push((part, step.into(), ms));
        *last = Instant::now();
    }

    fn part_ms(&self, part: &str) -> f64 {
        let steps = self.steps.iter().filter(|step| step.0 == part);
        steps.map(|step| step.2).sum()
    }
}

/// All frames; sites and operations are sums over the scans.
#[derive(Default)]
pub(crate) struct Record {
    pub(crate) frames: Vec<Frame>,
    /// Of each scan's first frame after the model was loaded.
    pub(crate) first_ms: Vec<f64>,
    scans: usize,
    sites: BTreeMap<String, usize>,
    /// By part, as the layers are defined, and what the registers multiplied: tiles of 2x2 cells need less.
    flop: BTreeMap<&'static str, [f64; 2]>,
}

impl Record {
    /// Counts a step of a scan.
    pub(crate) fn count(&mut self, part: &'static str, step: &Step, flop: [f64; 2]) {
        self.add(part, flop);
        if step.name != "rulebooks" {
            *self.sites.entry(step.name.into()).or_default() += step.rows;
        }
    }

    /// Counts the end of a scan: what its feature rows cost, the candidates.
    pub(crate) fn count_rows(&mut self, [features, head]: [f64; 2], candidates: u32) {
        self.add("dense2d", [features; 2]);
        self.add("head", [head; 2]);
        *self.sites.entry("candidates".into()).or_default() += candidates as usize;
        self.scans += 1;
    }

    fn add(&mut self, part: &'static str, flop: [f64; 2]) {
        let sums = self.flop.entry(part).or_default();
        *sums = [0, 1].map(|i| sums[i] + flop[i]);
    }

    /// Sites and GFLOP are means over the scans; `peak_share` is the part of `peak_gflops` that multiplied.
    pub(crate) fn json(&self, peak_gflops: f64) -> Value {
        let scans = self.scans.max(1) as f64;
        let sites = self.sites.iter();
        let sites =
            sites.map(|(name, count)| (name.clone(), (*count as f64 / scans).round() as u64));
        let mean = |flop: f64| 1e-9 * flop / scans;
        let gflop = |kind: usize| -> Value {
            let parts = PARTS[1..].iter().map(|part| (*part, self.flop[part][kind]));
            let all = parts.chain([("total", self.flop.values().map(|sums| sums[kind]).sum())]);
            all.map(|(name, flop)| (name, rounded(mean(flop))))
                .collect()
        };
        // The head's time is not one of products: see what its part holds.
        let share = PARTS[1..3].iter().map(|part| {
            let seconds = 1e-3 * self.quantile(0.5, |frame| frame.part_ms(part));
            let gflops = mean(self.flop[part][1]) / seconds;
            (*part, rounded(gflops / peak_gflops))
        });
        json!({
            "sites": sites.collect::<Value>(),
            "ms_p50": self.milliseconds(0.5),
            "ms_p99": self.milliseconds(0.99),
            "gflop": gflop(0),
            "gflop_executed": gflop(1),
            "peak_share": share.collect::<Value>(),
            "peak_gflops": peak_gflops.round(),
            "frames": self.frames.len(),
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

    /// A line a step, over all frames of all scans.
    pub(crate) fn print(&self) {
        println!("{:24}   min ms   p50 ms   p99 ms", "step");
        let steps = self.frames.first().map_or(&[][..], |frame| &frame.steps);
        for (place, (_, name, _)) in steps.iter().enumerate() {
            self.print_line(name, |frame| frame.steps[place].2);
        }
        self.print_line("TOTAL", |frame| frame.total_ms);
        let first: Vec<_> = self.first_ms.iter().map(|ms| format!("{ms:.2}")).collect();
        println!("first frame              {}", first.join(" "));
    }

    fn print_line(&self, name: &str, value: impl Fn(&Frame) -> f64 + Copy) {
        let [min, p50, p99] = [0.0, 0.5, 0.99].map(|q| self.quantile(q, value));
        println!("{name:24} {min:8.2} {p50:8.2} {p99:8.2}");
    }
}

/// To four digits after the point.
fn rounded(value: f64) -> Value {
    json!((value * 1e4).round() / 1e4)
}

/// GFLOP/s of multiply-adds on registers alone (int8: of whole numbers), of one thread times `threads`.
pub(crate) fn peak_gflops(precision: Precision, threads: usize) -> f64 {
    /// Steps of a try: some milliseconds.
    const STEPS: usize = 500_000;
    const TRIES: usize = 15;
    let spin = match precision {
        Precision::Auto | Precision::F32 => spin::<f32>,
        Precision::Bf16 => spin::<Bf16>,
        Precision::Int8 if Level::best().widens_bytes() => spin::<i16>,
        Precision::Int8 => spin::<u8>,
    };
    let once = |_| {
        let start = Instant::now();
        let flop = spin(Level::best(), STEPS);
        1e-9 * flop / start.elapsed().as_secs_f64()
    };
    threads as f64 * (0..TRIES).map(once).fold(0.0, f64::max)
}
