//! Time of the network on real scans: `network --profile compact --precision bf16 --threads 2 --scan FILE --json`.
//!
//! `compact` has the weights of the shipped `kitti` model, `second` has weights by formula (none are trained). int8 measures
//! missing ranges on the mirrored scans (left to right). Prints one JSON object: milliseconds by part and by step,
//! sites, operations, and their share of the peak. Frames run as on the vehicle; the backbone reports when a step is done.

mod measure;
mod report;

use anyhow::{Context, Result, ensure};
use clap::Parser;
use mluc_backbone::Precision;
use mluc_dataset::{read_calibration, read_scan};
use mluc_kernels::Level;
use mluc_model::{Grid, Manifest, Model, Network, WeightSet, formula_weights};
use mluc_train::{TrainError, quantize::measure_ranges};
use std::path::{Path, PathBuf};

#[derive(Parser)]
struct Arguments {
    /// KITTI scans (f32 x, y, z, intensity); several make one report.
    #[arg(long = "scan", required = true, num_args = 1..)]
    scans: Vec<PathBuf>,
    /// On KITTI's range.
    #[arg(long, default_value = "compact", value_parser = ["compact", "second"])]
    profile: String,
    /// A model file in place of the profile.
    #[arg(long)]
    model: Option<PathBuf>,
    /// Of the backbone: f32, bf16 or int8; the head reads f32 rows.
    #[arg(long, default_value_t, value_parser = precision)]
    precision: Precision,
    #[arg(long, default_value_t = 2)]
    threads: usize,
    /// Registers of another processor, such as `avx2`, in place of the fastest of this one.
    #[arg(long)]
    level: Option<String>,
    /// Keep only the points that KITTI's left colour camera sees; `DIR/velodyne/NAME.bin` needs `DIR/calib/NAME.txt`.
    #[arg(long)]
    crop: bool,
    /// Frames of each scan that are timed, after two that are not.
    #[arg(long, default_value_t = 50)]
    rounds: usize,
    /// Time the refiner too, with so many candidates, at the boxes that were found and around them; it is not in the total.
    #[arg(long)]
    candidates: Option<usize>,
    /// Changes nothing: the output is always JSON.
    #[arg(long = "json")]
    _json: bool,
}

fn precision(word: &str) -> Result<Precision, String> {
    let found = Precision::ALL.into_iter().find(|one| one.name() == word);
    found.ok_or_else(|| "expected f32, bf16 or int8".to_string())
}

fn main() -> Result<()> {
    let arguments = Arguments::parse();
    if let Some(name) = &arguments.level {
        let level = Level::all().into_iter().find(|level| level.name() == name);
        let unknown = || format!("this processor has no registers `{name}`");
        level.with_context(unknown)?.restrict();
    }
    let (manifest, mut weights) = model(&arguments)?;
    let mut record = report::Record::default();
    let scans = arguments.scans.iter().map(|scan| Ok((scan, read(scan, arguments.crop)?)));
    let scans: Vec<_> = scans.collect::<Result<_>>()?;
    if arguments.precision == Precision::Int8 && !weights.is_calibrated() {
        // Ranges from the mirrored scans (left to right): similar to the measured scans, but not the same.
        let turned = scans.iter().map(|(_, points)| {
            let turned = points.iter().map(|&[x, y, z, i]| [x, -y, z, i]);
            Ok::<Vec<_>, TrainError>(turned.collect())
        });
        weights = measure_ranges(&manifest, &weights, turned)?;
    }
    let model = (&manifest, &weights, arguments.precision);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(arguments.threads);
    pool.build()?.install(|| {
        scans.iter().try_for_each(|(scan, points)| {
            let count = (arguments.rounds, arguments.candidates);
            let measured = measure::measure(model, points, count, &mut record);
            measured.with_context(|| scan.display().to_string())
        })
    })?;
    let peak_gflops = report::peak_gflops(arguments.precision, arguments.threads);
    println!("{:#}", record.json(peak_gflops));
    Ok(())
}

/// A scan's points; with `crop`, only those in the camera's picture, which KITTI's labels cover.
fn read(scan: &Path, crop: bool) -> Result<Vec<[f32; 4]>> {
    /// Width and height of most of KITTI's pictures, px.
    const PICTURE: [f64; 2] = [1242.0, 375.0];
    let mut points = read_scan(scan)?;
    if crop {
        let name = scan.file_name().unwrap_or_default();
        let path = scan.with_file_name("../calib").join(name).with_extension("txt");
        let camera = read_calibration(&path)?;
        let place = path.display();
        ensure!(camera.has_camera(), "{place}: P2: expected a camera's matrix, found zeros");
        points.retain(|&[x, y, z, _]| {
            let pixel = camera.project_point_to_image([x, y, z].map(f64::from));
            pixel.is_some_and(|pixel| (0..2).all(|i| (0.0..PICTURE[i]).contains(&pixel[i])))
        });
    }
    Ok(points)
}

fn model(arguments: &Arguments) -> Result<(Manifest, WeightSet)> {
    if arguments.model.is_none() && arguments.profile == "second" {
        let network = Network::second(Grid::kitti_second(), 3);
        let weights = formula_weights(&network);
        return Ok((Manifest::untrained("second", network), weights));
    }
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("../weights/paper/kitti.safetensors");
    let model = Model::read(arguments.model.as_ref().unwrap_or(&shipped))?;
    Ok((model.manifest, model.weights))
}
