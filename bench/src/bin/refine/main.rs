//! How good and how fast a refiner is on labelled scans, without a network: simulated proposals around each labelled
//! object, the refined box against the label. `--json` prints one object for a program. Other modes: every cluster of
//! whole frames, frames made to be expensive, and the ground beside another program's.

mod adversarial;
mod boxes;
mod ground;
mod quality;
mod scene;
mod timing;
mod whole;

use std::path::PathBuf;

use anyhow::{Context, Result};
use clap::Parser;
use minijinja::Environment;
use minijinja::value::Serde;
use mluc_bench::{inputs, on_threads};
use mluc_dataset::Dataset;
use mluc_model::Model;
use mluc_refiner::{ClusterScorer, Refiner, Settings, Variant};
use serde::Serialize;
use serde_json::{Value, json};

/// Quality and time of a refiner on a folder of labelled scans.
#[derive(Parser)]
struct Arguments {
    /// Folder in KITTI's layout: velodyne, label_2, calib.
    #[arg(long)]
    dataset: Option<PathBuf>,
    /// paper, paper-corrected, range-scaled or none.
    #[arg(long, default_value = "range-scaled", value_parser = variant)]
    refiner: Variant,
    /// Settings of the refiner as JSON, for experiments: '{"join_m":0.5}'.
    #[arg(long, value_parser = |text: &str| serde_json::from_str::<Settings>(text))]
    settings: Option<Settings>,
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
    /// Every cluster of each frame, without proposals.
    #[arg(long)]
    everything: bool,
    /// Our ground beside another program's: a folder of files NAME.ground, one byte a point, 1 for ground.
    #[arg(long)]
    ground: Option<PathBuf>,
    /// Frames made to be expensive, without a data set.
    #[arg(long)]
    adversarial: bool,
    /// With --adversarial: a limit on a frame's time beside that on its work, ms.
    #[arg(long)]
    limit_ms: Option<f64>,
    /// Threads of the pool around it; the refiner works in one.
    #[arg(long, default_value_t = 1)]
    threads: usize,
    /// One JSON object on stdout.
    #[arg(long)]
    json: bool,
}

fn variant(name: &str) -> Result<Variant, String> {
    let names = Variant::ALL.map(Variant::name);
    Variant::from_name(name).ok_or_else(|| format!("expected one of {names:?}"))
}

fn main() -> Result<()> {
    let arguments = Arguments::parse();
    let scorer = arguments.looks.as_ref().map(|path| {
        let scorer = ClusterScorer::of_model(&Model::read(path)?.weights);
        scorer.with_context(|| format!("{}: no clusters.looks", path.display()))
    });
    let setup = Setup {
        settings: Settings {
            variant: arguments.refiner,
            ..arguments.settings.clone().unwrap_or_default()
        },
        scorer: scorer.transpose()?,
        json: arguments.json,
    };
    on_threads(arguments.threads, || run(&arguments, &setup))
}

fn run(arguments: &Arguments, setup: &Setup) -> Result<()> {
    if arguments.adversarial {
        return adversarial::run(setup, arguments.limit_ms);
    }
    let dataset = arguments.dataset.as_ref();
    let dataset =
        dataset.context("--dataset is missing: a folder with velodyne, label_2 and calib")?;
    let dataset = Dataset::open(dataset)?;
    let frames = scene::read(&dataset, &arguments.class, arguments.every)?;
    if arguments.everything {
        return whole::run(setup, &frames);
    }
    if let Some(answers) = &arguments.ground {
        return ground::run(setup, &frames, answers);
    }
    boxes::run(setup, &frames, arguments.proposals)
}

/// What a person reads of a report.
fn table(template: &str, report: &Value) -> String {
    let values = Serde(json!({"report": report}));
    let text = Environment::new().render_str(template, values);
    text.expect("a template that fits its values")
}

struct Setup {
    settings: Settings,
    /// Of `--looks`.
    scorer: Option<ClusterScorer>,
    json: bool,
}

impl Setup {
    fn refiner(&self) -> Result<Refiner> {
        let (sensor, scorer) = (inputs::sensor(), self.scorer.clone());
        Ok(Refiner::with_scorer(
            self.settings.clone(),
            &sensor,
            scorer,
        )?)
    }

    /// One JSON object on stdout, or the text that a person reads.
    fn print(&self, report: &impl Serialize, text: impl FnOnce()) -> Result<()> {
        if self.json {
            println!("{}", serde_json::to_string(report)?);
        } else {
            text();
        }
        Ok(())
    }
}

/// A figure of a report; 0 where it is missing.
fn figure(report: &Value, key: &str) -> f64 {
    report[key].as_f64().unwrap_or(0.0)
}

/// One object of several.
fn merged<const N: usize>(parts: [Value; N]) -> Value {
    let fields = parts.iter().filter_map(Value::as_object).flatten();
    fields
        .map(|(key, value)| (key.clone(), value.clone()))
        .collect()
}
