//! A whole training run: data, steps, log, checkpoints, model file.

use std::fs::File;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use mluc_model::{Manifest, Model, ModelError, Provenance, model_bytes};
use mluc_refiner::Looks;

use super::augment::Augmentation;
use super::check;
use super::checkpoint::{self, write_atomically};
use super::clusters::fit_looks;
use super::database::{Database, mean_boxes};
use super::error::TrainError;
use super::export;
use super::folder;
use super::import;
use super::loader::Preparer;
use super::log::{Log, Progress};
use super::losses::MetricSettings;
use super::optimizer::Schedule;
use super::settings::{Kind, Setting, Settings};
use super::source::{FolderSource, Source};
use super::targets::Anchors;
use super::trainer::Trainer;
use super::validate::validate;
use crate::dataset::Dataset;

/// Frames that the judge of clusters is fitted on.
const CLUSTER_FRAMES: usize = 300;

/// What a run tells while it goes on.
pub enum Event<'a> {
    /// Something worth a line.
    Note(String),
    /// A line of the log.
    Progress(&'a Progress),
}

/// A run, its data read and its state restored.
pub struct Run {
    settings: Settings,
    manifest: Manifest,
    trainer: Trainer,
    source: FolderSource,
    database: Database,
    looks: Option<Looks>,
    /// Settings and data, which a checkpoint must share.
    origin: String,
    _lock: File,
}

impl Run {
    /// Reads what the training split says, and the checkpoint where there is one.
    pub fn prepare(settings: &Settings, tell: &mut dyn FnMut(Event)) -> Result<Run, TrainError> {
        settings.check()?;
        let lock = folder::enter(&settings.out)?;
        let data = settings.data.join("train");
        let mut manifest = settings.manifest();
        let names = manifest.classes.iter().map(|c| c.name.clone()).collect();
        let dataset = check::training_split(settings)?;
        check::validation_split(settings, tell)?;
        let origin = check::origin(settings, &dataset)?;
        let source =
            FolderSource::new(dataset, names).with_made_up(settings.kind.learns_from_made_up());
        for (class, mean) in manifest
            .classes
            .iter_mut()
            .zip(mean_boxes(&source, settings.classes())?)
        {
            if mean.count == 0 {
                return Err(TrainError::NoObjects {
                    path: data,
                    class: class.name.clone(),
                });
            }
            (class.size_m, class.bottom_z_m) = (mean.size_m, mean.bottom_z_m);
            tell(Event::Note(format!(
                "{}: {} objects, mean {:.2} x {:.2} x {:.2} m, bottom at {:.2} m",
                class.name,
                mean.count,
                mean.size_m[0],
                mean.size_m[1],
                mean.size_m[2],
                mean.bottom_z_m
            )));
        }
        place_generic_anchors(&mut manifest);
        manifest.validate().map_err(|cause| ModelError::InFile {
            path: data.clone(),
            cause: Box::new(cause),
        })?;
        check::points(&source, settings)?;
        let frames = if settings.augment {
            settings.database_frames
        } else {
            0
        };
        let database = Database::build(&source, settings.classes(), frames)?;
        let sizes: Vec<String> = database
            .samples
            .iter()
            .map(|s| s.len().to_string())
            .collect();
        tell(Event::Note(format!(
            "objects to paste, by class: {}",
            sizes.join(", ")
        )));
        let schedule = Schedule {
            rate_max: settings.learning_rate,
            steps: settings.steps,
        };
        let mut trainer =
            Trainer::new(&manifest.network, schedule, metric(settings), settings.seed);
        if settings.bf16 {
            trainer.chain.use_bf16();
        }
        let path = settings.out.join("checkpoint.safetensors");
        if checkpoint::load(&path, &mut trainer.state, &origin)? {
            let step = trainer.state.step;
            if step > settings.steps {
                return Err(TrainError::Checkpoint {
                    path,
                    expected: format!("a run of at most {} steps (--steps)", settings.steps),
                    found: format!("one of {step}"),
                });
            }
            tell(Event::Note(format!("resumed at step {step}")));
        } else {
            folder::refuse_other(&settings.out, "model.safetensors")?;
            if let Some(path) = &settings.init {
                let text = import::start_from(path, &manifest, &mut trainer)?;
                tell(Event::Note(text));
            }
        }
        Ok(Run {
            settings: settings.clone(),
            manifest,
            trainer,
            source,
            database,
            looks: None,
            origin,
            _lock: lock,
        })
    }

    /// A finished model whose threshold was chosen or whose ranges were measured since: to write it again would lose them.
    fn is_refined(&self) -> bool {
        let model = Model::read(&self.settings.out.join("model.safetensors"));
        let step = self.trainer.state.step;
        step == self.settings.steps
            && model.is_ok_and(|model| {
                let from = model.manifest.provenance;
                from.steps == step
                    && !(from.threshold_choice.is_empty() && from.calibration.is_empty())
            })
    }

    /// Trains to the last step, judges the model on `val/`, writes its file; returns the path.
    pub fn finish(mut self, tell: &mut dyn FnMut(Event)) -> Result<PathBuf, TrainError> {
        let settings = self.settings.clone();
        if self.is_refined() {
            tell(Event::Note(
                "already trained; its threshold or int8 ranges were set since, so it stays as it is"
                    .into(),
            ));
            return Ok(settings.out.join("model.safetensors"));
        }
        let augmentation = settings.augment.then(|| Augmentation {
            database: std::mem::take(&mut self.database),
            wanted: settings.objects_wanted(),
            made_up: settings.improvements().made_up,
            classes_m: classes_m(&self.manifest),
            mirror_x: settings.setting == Setting::Udi,
        });
        if settings.looks {
            let (manifest, seed) = (&self.manifest, settings.seed);
            let looks = fit_looks(&self.source, manifest, CLUSTER_FRAMES, seed)?;
            self.looks = Some(looks);
        }
        let anchors = Anchors::of(&self.manifest);
        let source = Arc::new(self.source.clone());
        let network = &self.manifest.network;
        let preparer = Preparer::new(
            source,
            augmentation,
            anchors,
            network,
            settings.batch,
            settings.seed,
        )
        .with_background_cells(settings.improvements().background_cells);
        let batches = preparer.spawn(self.trainer.state.step..settings.steps);
        let begun = self.trainer.state.step > 0;
        let mut log = Log::open(&settings.out.join("train.jsonl"), &settings, begun)?;
        let epoch_steps = (self.source.count().div_ceil(settings.batch) as u64).max(1);
        while self.trainer.state.step < settings.steps {
            let waited = Instant::now();
            let step = self.trainer.state.step;
            let batch = batches
                .recv()
                .map_err(|_| TrainError::LoaderEnded { step })??;
            let wait = 1e3 * waited.elapsed().as_secs_f64();
            let mut report = self.trainer.step(&batch)?;
            report.timing.wait = wait;
            let done = self.trainer.state.step;
            if let Some(progress) = log.add(&report, done)? {
                tell(Event::Progress(&progress));
            }
            if done == settings.steps {
                break;
            }
            if done.is_multiple_of(epoch_steps) {
                self.save()?;
                self.judge(tell)?;
            } else if done.is_multiple_of(settings.checkpoint_every) {
                self.save()?;
            }
        }
        self.save()?;
        self.judge(tell)?;
        self.save()
    }

    /// Validates the model file just written; its figures go into the next one and `validation.json`.
    fn judge(&mut self, tell: &mut dyn FnMut(Event)) -> Result<(), TrainError> {
        let (folder, frames) = (
            self.settings.data.join("val"),
            self.settings.validate_frames,
        );
        if frames == 0 || !folder.is_dir() {
            return Ok(());
        }
        let model = Model::read(&self.settings.out.join("model.safetensors"))?;
        let figures = validate(&model, &Dataset::open(&folder)?, frames)?;
        for c in &figures.classes {
            let (name, iou, ap) = (&c.class, c.iou_min, c.ap_r40);
            tell(Event::Note(format!(
                "{name}: AP R40 {ap:.2} at overlap {iou}, {} labels",
                c.labels
            )));
        }
        let (map, count) = (figures.map_known, figures.frames);
        tell(Event::Note(format!(
            "mean AP of the known classes {map:.2} on {count} frames"
        )));
        let path = self.settings.out.join("validation.json");
        let failed = |e: serde_json::Error| TrainError::Io {
            path: path.clone(),
            cause: e.into(),
        };
        write_atomically(&path, &serde_json::to_vec(&figures).map_err(failed)?)?;
        self.manifest.provenance.metrics = figures.metrics();
        Ok(())
    }

    /// Checkpoint and model file. A model that nobody would take (values that are no numbers) leaves the last good checkpoint.
    fn save(&self) -> Result<PathBuf, TrainError> {
        let (settings, state) = (&self.settings, &self.trainer.state);
        let chain = &self.trainer.chain;
        let mut manifest = export::finish(
            self.manifest.clone(),
            chain,
            &state.parameters,
            &state.running,
        );
        manifest.provenance = Provenance {
            data: settings
                .data
                .file_name()
                .unwrap_or_default()
                .to_string_lossy()
                .into_owned(),
            seed: settings.seed,
            steps: state.step,
            batch: settings.batch as u32,
            commit: settings.commit.clone(),
            metrics: self.manifest.provenance.metrics.clone(),
            threshold_choice: String::new(),
            calibration: String::new(),
        };
        let mut weights = export::weights(chain, &state.parameters, &state.running);
        if let Some(looks) = &self.looks {
            looks.write(&mut weights);
        }
        let bytes = model_bytes(&manifest, &weights)?;
        let checkpoint = settings.out.join("checkpoint.safetensors");
        checkpoint::save(&checkpoint, state, &self.origin)?;
        let path = settings.out.join("model.safetensors");
        write_atomically(&path, &bytes)?;
        Ok(path)
    }
}

fn metric(settings: &Settings) -> MetricSettings {
    let improvements = settings.improvements();
    MetricSettings {
        prototype_scale: settings.prototype_scale(),
        variance_weight: settings.variance_weight,
        pull_weight: improvements.pull_weight,
        push_weight: match settings.kind {
            Kind::MetricOpen => improvements.pull_weight,
            _ => 0.0,
        },
        unknown_weight: improvements.unknown_weight,
    }
}

/// Anchors without a class stand where the classes' objects stand on average.
fn place_generic_anchors(manifest: &mut Manifest) {
    let count = manifest.classes.len().max(1) as f32;
    let bottom_z_m = manifest.classes.iter().map(|c| c.bottom_z_m).sum::<f32>() / count;
    for anchor in &mut manifest.generic {
        anchor.bottom_z_m = bottom_z_m;
    }
}

fn classes_m(manifest: &Manifest) -> Vec<[f64; 3]> {
    let sizes = manifest
        .classes
        .iter()
        .map(|class| class.size_m.map(f64::from));
    sizes.collect()
}
