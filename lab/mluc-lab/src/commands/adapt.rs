//! `mluc-lab adapt`: weights for one sensor and the classes that its user knows, from the shipped weights. Each step stores its result
//! in the folder; a restarted command continues after the last finished step.

mod mean;
mod plan;
mod report;

use super::terminal::{Threads, counted, print_err, print_out};
use super::train::{train, tune_memory};
use super::{quantize::RANGE_FRAMES, quantize::quantized, simulate::export_with_progress};
use anyhow::{Context, Result, ensure};
use clap::Args;
use mluc_backbone::Precision;
use mluc_dataset::{Dataset, whole_file::write_whole};
use mluc_evaluate::pipeline::{DetectedFrame, FrameSet, ModelJudgement, choose_profiles};
use mluc_evaluate::pipeline::{detect_frames, judge, write_precisions, write_profiles};
use mluc_model::{Model, SensorProfile, Takes, model_bytes};
use mluc_refiner::Settings;
use mluc_simulate::{Class, Split, rays};
use mluc_train::{check_known, enter};
use plan::{Plan, Request};
use std::path::{Path, PathBuf};

/// Initial weights without --init.
const ANY_OPEN: &[u8] = include_bytes!("../../../../weights/any-open.safetensors");

/// Adapt the weights to one sensor and the classes that you know, in a given time: simulates scans of this very sensor, trains on from
/// the shipped weights, measures int8's ranges, chooses the scores of the profiles, and evaluates the model before and after.
///
/// DIR gets model.safetensors and report.md. The time that each step takes is estimated and printed first. A command that was interrupted continues when it is
/// started again. The validation scans are simulated: real scans decide (evaluate ap).
#[derive(Args)]
pub(crate) struct AdaptArguments {
    /// The sensor: a product of `sensors/`, or a TOML file like those (`mluc-lab sensor` writes one).
    #[arg(long, value_name = "NAME|FILE")]
    sensor: String,
    /// The classes to know: car, van, truck, pedestrian, cyclist, golf_cart, forklift; all others are unknown.
    #[arg(long, value_delimiter = ',', value_name = "CLASS,..")]
    #[arg(default_value = "car,pedestrian,cyclist")]
    known: Vec<Class>,
    /// Hours that all of it may take on this machine.
    #[arg(long, default_value_t = 1.0, value_parser = hours, value_name = "HOURS")]
    hours: f64,
    /// Begin with the weights of this model file [default: the shipped any-open].
    #[arg(long, value_name = "FILE")]
    init: Option<PathBuf>,
    /// Folder of the result.
    #[arg(long)]
    out: PathBuf,
    #[command(flatten)]
    threads: Threads,
}

fn hours(text: &str) -> Result<f64, String> {
    // The number has few digits, so that plan.json keeps it exactly.
    let hours = text.parse().ok().map(|h: f64| (1e6 * h).round() / 1e6);
    let hours = hours.filter(|h| *h > 0.0 && *h <= 1000.0);
    hours.ok_or_else(|| format!("expected more than 0 and at most 1000, found '{text}'"))
}

pub(crate) fn run(arguments: AdaptArguments) -> Result<()> {
    tune_memory();
    arguments.threads.start()?;
    let out = &arguments.out;
    let init = match &arguments.init {
        Some(path) => std::fs::read(path).with_context(|| path.display().to_string())?,
        None => ANY_OPEN.to_vec(),
    };
    let is_known = |class: &Class| arguments.known.contains(class);
    let known: Vec<String> = Class::REAL.into_iter().filter(is_known).map(lower).collect();
    check_known(&known)?;
    let from = arguments.init.as_deref().unwrap_or("any-open".as_ref());
    let model = Model::from_bytes(&init).with_context(|| from.display().to_string())?;
    let request = Request {
        sensor: SensorProfile::load(&arguments.sensor)?,
        init: format!("{:016x}", model.fingerprint),
        known,
        hours: arguments.hours,
        version: env!("CARGO_PKG_VERSION").into(),
    };
    let [model, first] = ["model.safetensors", "init.safetensors"].map(|name| out.join(name));
    for left in [&model, &out.join("scans"), &out.join("run")] {
        ensure!(
            out.join("plan.json").exists() || !left.exists(),
            "{}: expected nothing of another run (plan.json is missing), found it; name another folder",
            left.display()
        );
    }
    let _alone = enter(out)?;
    let plan = Plan::of(request, &init, out)?;
    let place = Adaptation { out, plan };
    if !place.is_done() {
        place.simulate()?;
        print_err("step 2 of 4: judge the model that training begins with");
        place.judged("before", &first)?;
        place.train()?;
        place.finish_model()?;
    }
    let before = place.judged("before", &first)?;
    let after = place.judged("after", &model)?;
    let words = format!("--model {} --sensor {}", model.display(), arguments.sensor);
    let adapted = Model::read(&model)?;
    let text = report::markdown(&place.plan, &adapted, [&before, &after], &words);
    let path = out.join("report.md");
    write_whole(&path, text.as_bytes()).with_context(|| path.display().to_string())?;
    print_out(text)?;
    print_out(format_args!("{}\n{}", path.display(), model.display()))
}

/// A class name as in a model.
fn lower(class: Class) -> String {
    class.name().to_ascii_lowercase()
}

struct Adaptation<'a> {
    out: &'a Path,
    plan: Plan,
}

impl Adaptation<'_> {
    fn model(&self) -> PathBuf {
        self.out.join("model.safetensors")
    }

    fn run_folder(&self) -> PathBuf {
        self.out.join("run")
    }

    fn scans(&self, split: Split) -> PathBuf {
        self.out.join("scans").join(split.name())
    }

    fn simulate(&self) -> Result<()> {
        print_err("step 1 of 4: simulate");
        let counts = [self.plan.scans, self.plan.val_scans];
        for (split, scans) in [Split::Train, Split::Val].into_iter().zip(counts) {
            let options = self.plan.request.export(split, scans, self.scans(split));
            export_with_progress(&options)?;
        }
        Ok(())
    }

    fn train(&self) -> Result<()> {
        print_err("step 3 of 4: train");
        let (request, scans) = (&self.plan.request, self.out.join("scans"));
        let mut settings = request.settings(&scans, &self.run_folder(), self.out);
        (settings.steps, settings.bf16) = (self.plan.steps, self.plan.bf16);
        train(&settings).map(drop)
    }

    /// Whether the model is complete: it has the figures that are written last.
    fn is_done(&self) -> bool {
        let [last, _] = Precision::Int8.metrics();
        Model::read(&self.model())
            .is_ok_and(|model| model.manifest.provenance.metrics.contains_key(&last))
    }

    /// Finishes the run's model with int8 ranges and the scores of its profiles.
    fn finish_model(&self) -> Result<()> {
        print_err("step 4 of 4: int8 ranges, scores, figures");
        let (trained, path) = (self.run_folder().join("model.safetensors"), self.model());
        let (scans, mut train) = (self.scans(Split::Train), Model::read(&trained)?);
        let first = Model::read(&self.out.join("init.safetensors"))?;
        train.manifest.provenance.data = format!("sim-any, {}", self.plan.request.sensor.name);
        if mean::move_half_way(&mut train, &first) {
            train.manifest.provenance.data += "; mean with the first weights";
        }
        let sensor = &self.plan.request.sensor;
        // A model's sensor height is at least 0.1 m.
        let height_m = sensor.height_m.map(|height_m| height_m.max(0.1));
        train.manifest.sensor_height_m = height_m.unwrap_or(train.manifest.sensor_height_m);
        let dataset = Dataset::open(&scans)?;
        let (mut manifest, weights) = quantized(&train, &dataset, &scans, RANGE_FRAMES)?;
        train.manifest.empty_objectness_max = manifest.empty_objectness_max;
        let (set, frames, judgement) = self.judge(&train)?;
        manifest.provenance.threshold_choice = "one half: more likely unknown than known".into();
        let beams = sensor.elevations_deg.len() as f32;
        let mut takes = Takes::like(beams, rays(sensor), sensor.height_m.unwrap_or_default());
        // Beams above the horizon may see only the sky.
        let below = sensor.elevations_deg.iter().filter(|deg| **deg < 0.0).count() as f32 / beams;
        for [low, _] in [&mut takes.beams, &mut takes.points] {
            *low = (*low as f32 * below) as u32;
        }
        // The units may point in different directions.
        takes.beams[1] *= sensor.units.len().max(1) as u32;
        if sensor.wave.is_some() {
            takes.beams = [0, u32::MAX];
        }
        if sensor.height_m.is_none() {
            // The simulator varied the height.
            takes.height_m = manifest.takes().height_m;
        }
        manifest.takes = Some(takes);
        let bytes = model_bytes(&manifest, &weights)?;
        write_whole(&path, &bytes).with_context(|| path.display().to_string())?;
        let (model, rules, settings) = (Model::read(&path)?, &judgement.rules, Settings::default());
        let chosen = choose_profiles(&model, &set, &frames, rules, &settings)?;
        write_profiles(&path, &model, &chosen, &set.describe())?;
        let unknown = self.unknown(&model);
        let count = Precision::ALL.len() * set.names().len();
        Ok(counted("precisions", count, |step| {
            write_precisions(&path, &set, &unknown, &settings, step)
        })?)
    }

    /// Classes that neither a model nor this adaptation knows.
    fn unknown(&self, model: &Model) -> Vec<String> {
        let mut known = model.manifest.class_names();
        known.extend(self.plan.request.known.clone());
        let mut unknown = Class::REAL.map(lower).to_vec();
        unknown.retain(|name| !known.contains(name));
        unknown
    }

    /// A model's detections on the validation scans, and their evaluation.
    fn judge(&self, model: &Model) -> Result<(FrameSet, Vec<DetectedFrame>, ModelJudgement)> {
        let set = FrameSet::open(&self.scans(Split::Val), None, self.plan.val_scans as usize)?;
        let frames = counted("network", set.names().len(), |step| {
            detect_frames(Precision::default(), model, &set, step)
        })?;
        let unknown = self.unknown(model);
        let mut model = model.clone();
        // The same overlaps before and after, for any initial weights.
        model.manifest.name = "any".into();
        let judgement = judge(&model, &set, &frames, &unknown, &Settings::default())?;
        Ok((set, frames, judgement))
    }

    /// The figures of a model file, from `NAME.json` where it belongs to this very file.
    fn judged(&self, name: &str, path: &Path) -> Result<report::Figures> {
        let model = Model::read(path)?;
        let file = self.out.join(format!("{name}.json"));
        let kept = std::fs::read_to_string(&file).ok();
        let kept = kept.and_then(|text| serde_json::from_str::<report::Figures>(&text).ok());
        if let Some(figures) = kept.filter(|f| f.fingerprint == model.fingerprint) {
            return Ok(figures);
        }
        let figures = report::Figures::of(&model, &self.judge(&model)?.2);
        let text = serde_json::to_string_pretty(&figures)?;
        write_whole(&file, text.as_bytes()).with_context(|| file.display().to_string())?;
        Ok(figures)
    }
}
