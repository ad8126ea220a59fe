//! Time of the network on real scans: `network --profile compact --precision bf16 --threads 2 --scan FILE --json`.
//!
//! `compact` has the weights of the shipped `kitti` model, `second` weights by formula (none are trained); int8 measures the ranges that it lacks on the scans turned left to right. With `--json` one object a run: milliseconds by part, what was computed and how far
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
use mluc_bench::inputs;
use mluc_model::{Grid, Manifest, Model, Network, WeightSet, formula_weights};
use mluc_train::{TrainError, quantize::measure_ranges};

#[derive(Parser)]
struct Arguments {
    /// KITTI scans (f32 x, y, z, intensity); several make one report.
    #[arg(long = "scan", required = true, num_args = 1..)]
    scans: Vec<PathBuf>,
    /// `compact` or `second`, on KITTI's range.
    #[arg(long, default_value = "compact")]
    profile: String,
    /// A model file in place of the profile.
    #[arg(long)]
    model: Option<PathBuf>,
    /// `f32`, `bf16` or `int8`, of the backbone; the head reads f32 rows.
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
    /// Leave out the warm-up at load, to see what it is worth to the first frame.
    #[arg(long)]
    cold: bool,
    /// One JSON object on stdout.
    #[arg(long)]
    json: bool,
}

fn main() -> Result<()> {
    let arguments = Arguments::parse();
    let (manifest, mut weights) = model(&arguments)?;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(arguments.threads)
        .build()?;
    let mut record = report::Record::default();
    let scans = arguments.scans.iter();
    let scans = scans
        .map(|scan| Ok((scan, read(scan, arguments.crop)?)))
        .collect::<Result<Vec<_>>>()?;
    if arguments.precision == Precision::Int8 && !weights.is_calibrated() {
        calibrate(
            &manifest,
            &mut weights,
            scans.iter().map(|scan| &scan.1[..]),
        )?;
    }
    for (scan, points) in scans {
        pool.install(|| {
            measure::measure(
                (&manifest, &weights, arguments.precision),
                &points,
                (arguments.rounds, arguments.cold),
                &mut record,
            )
        })
        .with_context(|| scan.display().to_string())?;
    }
    let peak_gflops = peak::gflops(arguments.precision, arguments.threads);
    if arguments.json {
        println!("{}", record.json(peak_gflops));
    } else {
        record.print();
    }
    Ok(())
}

fn model(arguments: &Arguments) -> Result<(Manifest, WeightSet)> {
    if let Some(path) = &arguments.model {
        let model = Model::read(path)?;
        return Ok((model.manifest, model.weights));
    }
    match arguments.profile.as_str() {
        "compact" => inputs::shipped(),
        "second" => {
            let network = Network::second(Grid::kitti_second(), 3);
            let weights = formula_weights(&network);
            Ok((Manifest::untrained("second", network), weights))
        }
        other => bail!("profile must be compact or second, found {other}"),
    }
}

/// Ranges for int8, of the scans turned left to right: like those that are measured, and not the same.
fn calibrate<'a>(
    manifest: &Manifest,
    weights: &mut WeightSet,
    scans: impl Iterator<Item = &'a [[f32; 4]]>,
) -> Result<()> {
    let turned = |points: &[[f32; 4]]| points.iter().map(|&[x, y, z, i]| [x, -y, z, i]).collect();
    let turned = scans.map(|points| Ok::<Vec<_>, TrainError>(turned(points)));
    *weights = measure_ranges(manifest, weights, turned)?;
    Ok(())
}

fn read(scan: &Path, crop: bool) -> Result<Vec<[f32; 4]>> {
    let bytes = std::fs::read(scan).with_context(|| scan.display().to_string())?;
    let mut points: Vec<[f32; 4]> = bytes
        .chunks_exact(16)
        .map(bytemuck::pod_read_unaligned)
        .collect();
    if crop {
        let view = crop::View::of(scan)?;
        points.retain(|point| view.sees(*point));
    }
    Ok(points)
}
