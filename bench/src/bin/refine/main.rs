//! Quality and time of a refiner without a network: `refine --dataset DIR --refiner range-scaled --proposals 20 --json`.
//!
//! DIR is a folder in KITTI's layout. Its labelled objects get simulated proposals, as of a detector that does not know their class. Prints one JSON
//! object: how far the refined boxes agree with the labels, and the time of a frame.

mod quality;
mod scene;
mod timing;

use anyhow::{Context, Result, ensure};
use clap::Parser;
use mluc_dataset::Dataset;
use mluc_model::{CLUSTER_SCORER, Model};
use mluc_refiner::{ClusterScorer, Refiner, Sensor, Settings, Variant};
use serde_json::json;
use std::path::{Path, PathBuf};

#[derive(Parser)]
struct Arguments {
    /// A folder with velodyne, label_2 and calib.
    #[arg(long)]
    dataset: PathBuf,
    /// paper, paper-corrected, range-scaled or none.
    #[arg(long, default_value = "range-scaled", value_parser = variant)]
    refiner: Variant,
    /// Score clusters as this model file has learned it (its tensor clusters.looks).
    #[arg(long, value_name = "FILE")]
    looks: Option<PathBuf>,
    /// Only objects of these classes, by the labels' names, such as golf_cart,forklift.
    #[arg(long, value_delimiter = ',')]
    class: Vec<String>,
    /// Proposals per frame in the timed part.
    #[arg(long, default_value_t = 20)]
    proposals: usize,
    #[arg(long, default_value_t = 1)]
    threads: usize,
    /// Changes nothing: the output is always JSON.
    #[arg(long = "json")]
    _json: bool,
}

fn variant(name: &str) -> Result<Variant, String> {
    Variant::from_name(name).ok_or_else(|| format!("expected one of {}", Variant::NAMES.join(", ")))
}

fn main() -> Result<()> {
    let arguments = Arguments::parse();
    let frames = scene::read(&Dataset::open(&arguments.dataset)?, &arguments.class)?;
    let place = arguments.dataset.display();
    let expected = format!("labelled objects (--class) with {} points or more", scene::POINTS_MIN);
    let has_objects = frames.iter().any(|frame| !frame.objects.is_empty());
    ensure!(has_objects, "{place}: expected {expected}, found none");
    let scorer = arguments.looks.as_ref().map(|path| {
        let scorer = ClusterScorer::of_model(&Model::read(path)?.weights);
        scorer.with_context(|| format!("{}: expected a tensor {CLUSTER_SCORER}", path.display()))
    });
    // The sensor of KITTI's scans.
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("../weights/paper/kitti.safetensors");
    let sensor = Sensor::from_manifest(&Model::read(&shipped)?.manifest);
    let settings = Settings::of(arguments.refiner);
    let mut refiner = Refiner::with_scorer(settings, &sensor, scorer.transpose()?)?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(arguments.threads).build()?;
    let report = pool.install(|| {
        let mut report = quality::report(&quality::judge(&frames, &mut refiner, sensor.height_m));
        report["refiner"] = json!(arguments.refiner.name());
        report["frames"] = json!(frames.len());
        report["proposals"] = json!(arguments.proposals);
        timing::time(&frames, &mut refiner, arguments.proposals, &mut report);
        report
    });
    println!("{report:#}");
    Ok(())
}
