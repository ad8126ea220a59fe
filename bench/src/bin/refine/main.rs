//! How good and how fast a refiner is on labelled scans, without a network: simulated proposals around each labelled
//! object, the refined box against the label. `--json` prints one object for a program. Other modes: every cluster of
//! whole frames, frames made to be dear, box fits side by side, and one setting varied.

mod adversarial;
mod ceiling;
mod ground;
mod proposals;
mod quality;
mod report;
mod scene;
mod timing;
mod vary;
mod whole;

use std::path::PathBuf;
use std::sync::OnceLock;

use anyhow::{Context, Result, bail};
use clap::Parser;
use mluc_dataset::Dataset;
use mluc_model::Model;
use mluc_refiner::fit::BoxFit;
use mluc_refiner::{ClusterScorer, Refiner, Settings, Study, Variant};

/// Quality and time of a refiner on a folder of labelled scans.
#[derive(Parser)]
struct Arguments {
    /// Folder in KITTI's layout: velodyne, label_2, calib.
    #[arg(long)]
    dataset: Option<PathBuf>,
    /// paper, paper-corrected, range-scaled or none.
    #[arg(long, default_value = "range-scaled")]
    refiner: String,
    /// Settings of the refiner as JSON, for experiments: '{"join_m":0.5}'.
    #[arg(long)]
    settings: Option<String>,
    /// Score unknown objects by their clusters and sizes, as this model file has learned it (its tensor clusters.looks).
    #[arg(long, value_name = "FILE")]
    looks: Option<PathBuf>,
    /// Objects of these classes alone, by the labels' names: golf_cart,forklift.
    #[arg(long, value_delimiter = ',')]
    class: Vec<String>,
    /// One frame in so many.
    #[arg(long, default_value_t = 1)]
    every: usize,
    /// Proposals a frame in the timing part.
    #[arg(long, default_value_t = 20)]
    proposals: usize,
    /// Timing at random points of the scan instead of at the labelled objects: dearer, walls and bushes are large.
    #[arg(long)]
    anywhere: bool,
    /// Every cluster of each frame, without proposals.
    #[arg(long)]
    everything: bool,
    /// Our ground beside another program's: a folder of files NAME.ground, one byte a point, 1 for ground.
    #[arg(long)]
    ground: Option<PathBuf>,
    /// Frames made to be dear, without a data set.
    #[arg(long)]
    adversarial: bool,
    /// With --adversarial: a limit on a frame's time beside that on its work, ms.
    #[arg(long)]
    limit_ms: Option<f64>,
    /// Every object with what its first proposal came to: to look at failures.
    #[arg(long)]
    list: bool,
    /// The three box fits side by side.
    #[arg(long)]
    fits: bool,
    /// One setting at several values, all else as it is: join_m=0.3,0.4,0.5 (may be given more than once).
    #[arg(long)]
    vary: Vec<String>,
    /// Threads of the pool around it; the refiner works in one.
    #[arg(long, default_value_t = 1)]
    threads: usize,
    /// One JSON object on stdout.
    #[arg(long)]
    json: bool,
}

fn main() -> Result<()> {
    let arguments = Arguments::parse();
    let settings = settings(&arguments)?;
    if let Some(path) = &arguments.looks {
        let scorer = ClusterScorer::of_model(&Model::read(path)?.weights);
        let scorer = scorer.with_context(|| format!("{}: no clusters.looks", path.display()))?;
        SCORER.get_or_init(|| scorer);
    }
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(arguments.threads)
        .build()?;
    pool.install(|| run(&arguments, settings))
}

fn settings(arguments: &Arguments) -> Result<Settings> {
    let Some(variant) = Variant::from_name(&arguments.refiner) else {
        let names = Variant::ALL.map(Variant::name);
        bail!("refiner {}: expected one of {names:?}", arguments.refiner);
    };
    let settings: Settings = match &arguments.settings {
        Some(text) => serde_json::from_str(text).context("--settings")?,
        None => Settings::default(),
    };
    Ok(Settings {
        variant,
        ..settings
    })
}

fn run(arguments: &Arguments, settings: Settings) -> Result<()> {
    if arguments.adversarial {
        return adversarial::run(settings, arguments.limit_ms, arguments.json);
    }
    let Some(dataset) = &arguments.dataset else {
        bail!("--dataset is missing: a folder with velodyne, label_2 and calib");
    };
    let dataset = Dataset::open(dataset)?;
    let frames = scene::read(&dataset, &arguments.class, arguments.every)?;
    if arguments.everything {
        return whole::run(&frames, &settings, arguments.json);
    }
    if let Some(answers) = &arguments.ground {
        return ground::run(&frames, &settings, answers, arguments.json);
    }
    if arguments.list {
        return report::list(&frames, settings);
    }
    if !arguments.vary.is_empty() {
        return vary::run(&frames, &settings, &arguments.vary);
    }
    if arguments.fits {
        let fits = [BoxFit::AxisAligned, BoxFit::MinimumArea, BoxFit::Closeness];
        let with = |fit| Settings {
            study: Study {
                box_fit: Some(fit),
                ..settings.study
            },
            ..settings.clone()
        };
        let rows = fits.map(|fit| (format!("{fit:?}"), with(fit)));
        return vary::table(&frames, &rows);
    }
    let report = report::measure(&frames, settings, arguments.proposals, arguments.anywhere)?;
    if arguments.json {
        println!("{}", serde_json::to_string(&report)?);
    } else {
        report.print();
    }
    Ok(())
}

/// Of `--looks`.
static SCORER: OnceLock<ClusterScorer> = OnceLock::new();

/// A refiner for the bench's sensor.
fn refiner(settings: Settings) -> Result<Refiner> {
    let scorer = SCORER.get().cloned();
    Ok(Refiner::with_scorer(settings, &scene::sensor(), scorer)?)
}
