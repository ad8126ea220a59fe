//! Time of the network on real scans: `network --profile compact --precision bf16 --threads 2 --scan FILE --json`.
//!
//! Weights by formula, or of a model. With `--json` one object a run: milliseconds by part, what was computed and how far
//! that is from what the registers can do; without it a table of every step. Frames run as on the vehicle; the backbone
//! says when a step is done.

mod crop;
mod measure;
mod peak;
mod report;

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use clap::Parser;
use mluc_backbone::Precision;
use mluc_model::{Grid, Manifest, Model, Network, WeightSet, formula_weights};

#[derive(Parser)]
struct Arguments {
    /// KITTI scans (f32 x, y, z, intensity); several make one report.
    #[arg(long = "scan", required = true, num_args = 1..)]
    scans: Vec<PathBuf>,
    /// `compact` or `second`, on KITTI's range.
    #[arg(long, default_value = "compact")]
    profile: String,
    /// A model file in place of the profile with weights by formula.
    #[arg(long)]
    model: Option<PathBuf>,
    /// `f32` or `bf16`, of the backbone; the head reads f32 rows.
    #[arg(long, default_value_t)]
    precision: Precision,
    #[arg(long, default_value_t = 2)]
    threads: usize,
    /// Points that KITTI's left colour camera sees, alone.
    #[arg(long)]
    crop: bool,
    /// Frames of each scan that are timed, after two that are not.
    #[arg(long, default_value_t = 50)]
    rounds: usize,
    /// One JSON object on stdout.
    #[arg(long)]
    json: bool,
}

fn main() -> Result<()> {
    let arguments = Arguments::parse();
    let (manifest, weights) = model(&arguments)?;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(arguments.threads)
        .build()?;
    let mut record = report::Record::default();
    for scan in &arguments.scans {
        let points = read(scan, arguments.crop)?;
        pool.install(|| {
            measure::measure(
                (&manifest, &weights, arguments.precision),
                &points,
                arguments.rounds,
                &mut record,
            )
        })
        .with_context(|| scan.display().to_string())?;
    }
    let peak_gflops = peak::gflops(arguments.precision, arguments.threads);
    match arguments.json {
        true => println!("{}", record.json(peak_gflops)),
        false => record.print(),
    }
    Ok(())
}

fn model(arguments: &Arguments) -> Result<(Manifest, WeightSet)> {
    if let Some(path) = &arguments.model {
        let model = Model::read(path)?;
        return Ok((model.manifest, model.weights));
    }
    let network = match arguments.profile.as_str() {
        "compact" => Network::compact(Grid::kitti_compact(), 3),
        "second" => Network::second(Grid::kitti_second(), 3),
        other => bail!("profile must be compact or second, found {other}"),
    };
    let weights = formula_weights(&network);
    Ok((Manifest::untrained(&arguments.profile, network), weights))
}

fn read(scan: &Path, crop: bool) -> Result<Vec<[f32; 4]>> {
    let bytes = std::fs::read(scan).with_context(|| scan.display().to_string())?;
    let mut points: Vec<[f32; 4]> = bytes
        .chunks_exact(16)
        .map(bytemuck::pod_read_unaligned)
        .collect();
    if crop {
        let view = crop::View::beside(scan)?;
        points.retain(|point| view.sees(*point));
    }
    Ok(points)
}
