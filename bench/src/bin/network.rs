//! Time of every step of the network on real scans, with weights by formula: `network --profile compact SCAN.bin ...`.
//!
//! The steps are told apart by the backbone's own observer; the last two lines are the stages as the vehicle runs them.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::Instant;

use anyhow::Context;
use clap::Parser;
use mluc_backbone::{Backbone, Coverage};
use mluc_head::Head;
use mluc_model::{Grid, Manifest, Model, Network, WeightSet, formula_weights};

#[derive(Parser)]
struct Arguments {
    /// KITTI scans (f32 x, y, z, intensity).
    #[arg(required = true)]
    scans: Vec<PathBuf>,
    /// `compact` or `second`, on KITTI's range.
    #[arg(long, default_value = "compact")]
    profile: String,
    /// A trained model in place of the profile with weights by formula.
    #[arg(long)]
    model: Option<PathBuf>,
    #[arg(long, default_value_t = 2)]
    threads: usize,
    /// Times that each scan is run; the first round is not counted.
    #[arg(long, default_value_t = 10)]
    rounds: usize,
}

fn main() -> anyhow::Result<()> {
    let arguments = Arguments::parse();
    let (manifest, weights) = model(&arguments)?;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(arguments.threads)
        .build()?;
    let mut times = Times::default();
    for scan in &arguments.scans {
        let bytes = std::fs::read(scan).with_context(|| scan.display().to_string())?;
        let points: Vec<[f32; 4]> = bytes
            .chunks_exact(16)
            .map(bytemuck::pod_read_unaligned)
            .collect();
        pool.install(|| measure(&arguments, &manifest, &weights, &points, &mut times))
            .with_context(|| scan.display().to_string())?;
    }
    times.print();
    Ok(())
}

fn model(arguments: &Arguments) -> anyhow::Result<(Manifest, WeightSet)> {
    if let Some(path) = &arguments.model {
        let model = Model::read(path)?;
        return Ok((model.manifest, model.weights));
    }
    let network = match arguments.profile.as_str() {
        "compact" => Network::compact(Grid::kitti_compact(), 3),
        "second" => Network::second(Grid::kitti_second(), 3),
        other => anyhow::bail!("profile must be compact or second, found {other}"),
    };
    let weights = formula_weights(&network);
    Ok((Manifest::untrained(&arguments.profile, network), weights))
}

fn measure(
    arguments: &Arguments,
    manifest: &Manifest,
    weights: &WeightSet,
    points: &[[f32; 4]],
    times: &mut Times,
) -> anyhow::Result<()> {
    let (mut backbone, mut head) = (
        Backbone::new(manifest, weights)?,
        Head::new(manifest, weights)?,
    );
    let (mut cells, mut rows, mut detections) = (vec![], vec![], vec![]);
    for round in 0..=arguments.rounds {
        times.counted = round > 0;
        let mut last = Instant::now();
        backbone.run_observed(points, Coverage::Active, &mut |level| {
            times.add(level.name, &mut last);
        });
        times.add("which features", &mut last);
        cells.resize(backbone.rows(), 0);
        rows.resize(backbone.rows() * backbone.feature_channels(), 0.0);
        let mut last = Instant::now();
        backbone.write_rows(&mut cells, &mut rows)?;
        times.add("features", &mut last);
        let mut last = Instant::now();
        backbone.run(points);
        backbone.write_rows(&mut cells, &mut rows)?;
        times.add("BACKBONE", &mut last);
        let counts = head.run(&cells, &rows, &mut detections)?;
        times.add("HEAD", &mut last);
        if round == 0 {
            println!("{} points, {} rows, {counts:?}", points.len(), cells.len());
        }
    }
    Ok(())
}

/// Milliseconds by step, in the order of their first appearance.
#[derive(Default)]
struct Times {
    counted: bool,
    order: Vec<String>,
    by_step: BTreeMap<String, Vec<f64>>,
}

impl Times {
    fn add(&mut self, step: &str, last: &mut Instant) {
        let now = Instant::now();
        if self.counted {
            if !self.by_step.contains_key(step) {
                self.order.push(step.into());
            }
            self.by_step
                .entry(step.into())
                .or_default()
                .push((now - *last).as_secs_f64() * 1e3);
        }
        *last = Instant::now();
    }

    fn print(&mut self) {
        println!(
            "{:24} {:>8} {:>8} {:>8}",
            "step", "min ms", "p50 ms", "max ms"
        );
        for step in &self.order {
            let Some(times) = self.by_step.get_mut(step) else {
                continue;
            };
            times.sort_by(f64::total_cmp);
            let (min, max) = (times[0], times[times.len() - 1]);
            println!(
                "{step:24} {min:8.2} {:8.2} {max:8.2}",
                times[times.len() / 2]
            );
        }
    }
}
