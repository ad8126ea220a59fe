//! How good and how fast a refiner is on labelled scans, without a network: simulated proposals around each labelled
//! object, the refined box against the label. `--json` prints one object for a program. `--adversarial`: frames made to be
//! expensive.

mod adversarial;
mod quality;
mod scene;
mod timing;

use std::path::PathBuf;

use anyhow::{Context, Result};
use clap::Parser;
use minijinja::Environment;
use minijinja::value::Serde;
use mluc_bench::{inputs, on_threads};
use mluc_dataset::Dataset;
use mluc_geometry::quantile_of;
use mluc_model::Model;
use mluc_refiner::{ClusterScorer, Refiner, Settings, Variant};
use serde::Serialize;
use serde_json::{Value, json};

use quality::{judge, quality};
use scene::Frame;
use timing::{in_words, time};

/// Quality and time of a refiner on a folder of labelled scans.
#[derive(Parser)]
struct Arguments {
    /// Folder in KITTI's layout: velodyne, label_2, calib.
    #[arg(long)]
    dataset: Option<PathBuf>,
    /// paper, paper-corrected, range-scaled or none.
    #[arg(long, default_value = "range-scaled", value_parser = variant)]
    refiner: Variant,
    /// Score unknown objects by their clusters and sizes, as this model file has learned it (its tensor clusters.looks).
    #[arg(long, value_name = "FILE")]
    looks: Option<PathBuf>,
    /// Objects of these classes alone, by the labels' names: golf_cart,forklift.
    #[arg(long, value_delimiter = ',')]
    class: Vec<String>,
    /// Proposals a frame in the timing part.
    #[arg(long, default_value_t = 20)]
    proposals: usize,
    /// Frames made to be expensive, without a data set.
    #[arg(long)]
    adversarial: bool,
    /// With --adversarial: a limit on a frame's time beside that on its work, ms.
    #[arg(long)]
    limit_ms: Option<f64>,
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
            ..Settings::default()
        },
        scorer: scorer.transpose()?,
        json: arguments.json,
    };
    on_threads(1, || run(&arguments, &setup))
}

fn run(arguments: &Arguments, setup: &Setup) -> Result<()> {
    if arguments.adversarial {
        return adversarial::run(setup, arguments.limit_ms);
    }
    let dataset = arguments.dataset.as_ref();
    let dataset =
        dataset.context("--dataset is missing: a folder with velodyne, label_2 and calib")?;
    let dataset = Dataset::open(dataset)?;
    let frames = scene::read(&dataset, &arguments.class)?;
    quality_and_time(setup, &frames, arguments.proposals)
}

/// Simulated proposals around each labelled object.
fn quality_and_time(setup: &Setup, frames: &[Frame], proposals: usize) -> Result<()> {
    let mut refiner = setup.refiner()?;
    let judged = judge(frames, &mut refiner);
    let (times, work) = time(frames, &mut refiner, proposals);
    let [work_p50, work_max] = [0.5, 1.0].map(|q| quantile_of(work.clone(), q).unwrap_or(0.0));
    let (name, count) = (setup.settings.variant.name(), frames.len());
    let about = json!({
        "refiner": name, "frames": count, "proposals": proposals, "work_p50": work_p50, "work_max": work_max,
    });
    let report = merged([about, quality(&judged), times]);
    setup.print(&report, || {
        println!("refiner {name}, {count} frames");
        println!("{}", table(include_str!("quality.txt"), &report));
        let times = in_words(&report);
        println!(
            "{proposals} proposals a frame: {times}; work p50 {work_p50:.0}, max {work_max:.0}"
        );
    })
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
