//! What was measured, as a table or as JSON.

use std::time::Instant;

use mluc_backbone::Step;
use serde_json::{Map, Value, json};

/// A part of the network, as the report names them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Part {
    Voxelize,
    /// Rulebooks included.
    Sparse3d,
    /// The fold of the height and the writing of feature rows included.
    Dense2d,
    /// All but the backbone: 1x1 convolutions, decoding, suppression, scores.
    Head,
}

const PARTS: [(Part, &str); 4] = [
    (Part::Voxelize, "voxelize"),
    (Part::Sparse3d, "sparse3d"),
    (Part::Dense2d, "dense2d"),
    (Part::Head, "head"),
];

/// Milliseconds of one frame.
#[derive(Default)]
pub(crate) struct Frame {
    steps: Vec<(Part, String, f64)>,
    pub(crate) total_ms: f64,
}

impl Frame {
    pub(crate) fn add(&mut self, part: Part, step: &str, last: &mut Instant) {
        let now = Instant::now();
        self.steps
            .push((part, step.into(), (now - *last).as_secs_f64() * 1e3));
        *last = Instant::now();
    }

    fn part_ms(&self, part: Part) -> f64 {
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
    sites: Vec<(String, usize)>,
    /// As the layers are defined.
    flop: [f64; 4],
    /// What the registers multiplied: tiles of 2x2 cells need less.
    executed: [f64; 4],
    sparse_done: bool,
}

impl Record {
    /// Counts a step of a scan.
    pub(crate) fn count(&mut self, step: &Step, flop: f64, executed: f64) {
        match step.name {
            "voxels" => self.sparse_done = false,
            "bev" => self.sparse_done = true,
            "rulebooks" => return,
            _ => {}
        }
        let part = if self.sparse_done {
            Part::Dense2d
        } else {
            Part::Sparse3d
        };
        self.flop[part as usize] += flop;
        self.executed[part as usize] += executed;
        self.add_sites(step.name, step.rows);
    }

    /// Counts the end of a scan: its feature rows and what they cost, the candidates.
    pub(crate) fn count_rows(&mut self, rows: usize, [features, head]: [f64; 2], candidates: u32) {
        debug_assert!(rows == 0 || features > 0.0);
        for flop in [&mut self.flop, &mut self.executed] {
            flop[Part::Dense2d as usize] += features;
            flop[Part::Head as usize] += head;
        }
        self.add_sites("candidates", candidates as usize);
        self.scans += 1;
    }

    fn add_sites(&mut self, name: &str, count: usize) {
        match self.sites.iter_mut().find(|site| site.0 == name) {
            Some(site) => site.1 += count,
            None => self.sites.push((name.into(), count)),
        }
    }

    /// Sites and GFLOP are means over the scans; `peak_share` is the part of `peak_gflops` that multiplied.
    pub(crate) fn json(&self, peak_gflops: f64) -> Value {
        let scans = self.scans.max(1) as f64;
        let sites: Map<_, _> = self
            .sites
            .iter()
            .map(|(name, count)| (name.clone(), json!((*count as f64 / scans).round() as u64)))
            .collect();
        let (mut gflop, mut executed, mut share) = (Map::new(), Map::new(), Map::new());
        let mean = |flop: f64| 1e-9 * flop / scans;
        for part in [Part::Sparse3d, Part::Dense2d, Part::Head] {
            let name = PARTS[part as usize].1;
            let each = mean(self.executed[part as usize]);
            gflop.insert(name.into(), json!(rounded(mean(self.flop[part as usize]))));
            executed.insert(name.into(), json!(rounded(each)));
            // The head's time is not one of products: see what its part holds.
            if part != Part::Head {
                let seconds = 1e-3 * self.percentile(0.5, |frame| frame.part_ms(part));
                share.insert(name.into(), json!(rounded(each / seconds / peak_gflops)));
            }
        }
        for (flop, to) in [(&self.flop, &mut gflop), (&self.executed, &mut executed)] {
            to.insert("total".into(), json!(rounded(mean(flop.iter().sum()))));
        }
        json!({
            "sites": sites,
            "ms_p50": self.milliseconds(0.5),
            "ms_p99": self.milliseconds(0.99),
            "gflop": gflop,
            "gflop_executed": executed,
            "peak_share": share,
            "peak_gflops": peak_gflops.round(),
            "frames": self.frames.len(),
            "first_ms": rounded(self.first_ms.iter().copied().fold(0.0, f64::max)),
        })
    }

    fn milliseconds(&self, share: f64) -> Value {
        let mut parts: Map<_, _> = PARTS
            .iter()
            .map(|&(part, name)| {
                let value = self.percentile(share, |frame| frame.part_ms(part));
                (name.into(), json!(rounded(value)))
            })
            .collect();
        let total = self.percentile(share, |frame| frame.total_ms);
        parts.insert("total".into(), json!(rounded(total)));
        Value::Object(parts)
    }

    fn percentile(&self, share: f64, value: impl Fn(&Frame) -> f64) -> f64 {
        let mut values: Vec<f64> = self.frames.iter().map(value).collect();
        values.sort_by(f64::total_cmp);
        let last = values.len().saturating_sub(1);
        let place = (share * values.len() as f64) as usize;
        values.get(place.min(last)).copied().unwrap_or(0.0)
    }

    /// A line a step, over all frames of all scans.
    pub(crate) fn print(&self) {
        println!(
            "{:24} {:>8} {:>8} {:>8}",
            "step", "min ms", "p50 ms", "p99 ms"
        );
        let names: Vec<_> = self
            .frames
            .first()
            .into_iter()
            .flat_map(|frame| &frame.steps)
            .collect();
        for (place, (_, name, _)) in names.iter().enumerate() {
            self.print_line(name, |frame| frame.steps[place].2);
        }
        self.print_line("TOTAL", |frame| frame.total_ms);
        let first: Vec<_> = self.first_ms.iter().map(|ms| format!("{ms:.2}")).collect();
        println!("first frame              {}", first.join(" "));
    }

    fn print_line(&self, name: &str, value: impl Fn(&Frame) -> f64 + Copy) {
        let [min, p50, p99] = [0.0, 0.5, 0.99].map(|share| self.percentile(share, value));
        println!("{name:24} {min:8.2} {p50:8.2} {p99:8.2}");
    }
}

/// To four digits after the point.
fn rounded(value: f64) -> f64 {
    (value * 1e4).round() / 1e4
}
