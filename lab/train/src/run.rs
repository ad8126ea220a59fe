//! A whole training run: data, steps, log, checkpoints, model file.

use crate::error::{TrainError, refused};
use crate::loader::{BatchQueue, DataLoader};
use crate::log::{Log, TrainEvent};
use crate::{NetworkKind, check, checkpoint, export, import, run_folder, stream};
use crate::{cluster_scorer::fit_to_proposals, database, database::Database, database::mean_boxes};
use crate::{optimizer::Schedule, settings::TrainSettings, source::ScanSource, trainer::Trainer};
use mluc_backbone::Precision;
use mluc_evaluate::evaluate;
use mluc_evaluate::pipeline::{DetectedFrame, FrameSet, GatedObjects, detect_frames, paper_rules};
use mluc_model::{Manifest, Model, ModelError, Provenance, VoxelInput, model_bytes};
use mluc_refiner::ClusterScorer;
use std::{collections::BTreeMap, fs::File, io::Write, path::PathBuf};

/// Number of frames for the fit of the cluster scorer.
const CLUSTER_FRAMES: usize = 1200;

/// A run with its data read and its state restored.
pub struct Run {
    settings: TrainSettings,
    manifest: Manifest,
    trainer: Trainer,
    source: ScanSource,
    database: Database,
    cluster_scorer: Option<ClusterScorer>,
    /// Settings and data, which must equal those of a checkpoint.
    origin: String,
    _lock: File,
}

type Notify<'a> = &'a mut dyn FnMut(TrainEvent);

impl Run {
    /// Reads the statistics of the training split, and the checkpoint where there is one.
    pub fn prepare(settings: &TrainSettings, notify: Notify) -> Result<Run, TrainError> {
        check::check_known(&settings.known)?;
        let lock = run_folder::enter(&settings.out)?;
        let dataset = check::training_split(settings)?;
        check::validation_split(settings, notify)?;
        let origin = check::origin(settings, &dataset)?;
        let mut manifest = settings.manifest();
        let source = ScanSource {
            dataset,
            classes: manifest.class_names(),
            takes_synthetic_unknown: settings.kind.learns_from_synthetic_unknown(),
            input: manifest.network.input,
        };
        measure_anchors(&mut manifest, settings, &source, notify)?;
        check::points(&source, settings)?;
        check::examples(&source, settings)?;
        let frames = settings.database_frames();
        let database = database::build(&source, settings.classes(), frames)?;
        let sizes: Vec<_> = database.iter().map(|s| s.len().to_string()).collect();
        let text = format!("objects to paste, by class: {}", sizes.join(", "));
        notify(TrainEvent::Note(text));
        let schedule = Schedule::new(settings.learning_rate, settings.steps);
        let (network, losses) = (&manifest.network, settings.losses());
        let mut trainer = Trainer::new(network, schedule, losses, settings.seed);
        if settings.bf16 {
            trainer.chain.use_bf16();
        }
        let mut run = Run {
            settings: settings.clone(),
            manifest,
            trainer,
            source,
            database,
            cluster_scorer: None,
            origin,
            _lock: lock,
        };
        run.restore(notify)?;
        Ok(run)
    }

    /// Restores the run's checkpoint; else, with `--init`, another network's weights.
    fn restore(&mut self, notify: Notify) -> Result<(), TrainError> {
        let (settings, trainer) = (&self.settings, &mut self.trainer);
        let path = settings.out.join("checkpoint.safetensors");
        let text = if checkpoint::load(&path, &mut trainer.state, &self.origin)? {
            let step = trainer.state.step;
            if step > settings.steps {
                let expected = format!("a run of at most {} steps (--steps)", settings.steps);
                return Err(checkpoint::wrong(&path, expected, format!("one of {step}")));
            }
            format!("resumed at step {step} of {}", settings.steps)
        } else {
            run_folder::refuse_other(&settings.out, "model.safetensors")?;
            let Some(init) = &settings.init else {
                return Ok(());
            };
            import::start_from(init, &self.manifest, trainer)?
        };
        notify(TrainEvent::Note(text));
        Ok(())
    }

    fn model_path(&self) -> PathBuf {
        self.settings.out.join("model.safetensors")
    }

    /// Whether the model is finished and its threshold, profiles or ranges were set afterwards: writing it again would lose them.
    fn is_refined(&self) -> bool {
        let step = self.trainer.state.step;
        let is_refined = |model: Model| {
            let from = model.manifest.provenance;
            let choices = [from.threshold_choice, from.profile_choice, from.calibration];
            from.steps == step && !choices.concat().is_empty()
        };
        step == self.settings.steps && Model::read(&self.model_path()).is_ok_and(is_refined)
    }

    /// Trains to the last step, evaluates the model on `val/`, writes its file; returns the path.
    pub fn finish(mut self, notify: Notify) -> Result<PathBuf, TrainError> {
        if self.is_refined() {
            let text = "already trained; its threshold, profiles or int8 ranges were set since, so it stays as it is";
            notify(TrainEvent::Note(text.into()));
            return Ok(self.model_path());
        }
        let mut batches = self.begin(DataLoader::prepare)?;
        let (settings, first) = (self.settings.clone(), self.trainer.state.step);
        let mut log = Log::open(&settings, first > 0)?;
        let epoch_steps = (self.source.count().div_ceil(settings.batch) as u64).max(1);
        for step in first..settings.steps {
            if let Some(line) = log.add(self.trainer.step(&batches.take(step)?)?)? {
                notify(TrainEvent::Progress(&line));
            }
            let done = step + 1;
            let ends_epoch = done.is_multiple_of(epoch_steps);
            if done == settings.steps {
                break;
            } else if ends_epoch || done.is_multiple_of(settings.checkpoint_every) {
                self.save()?;
            }
            if ends_epoch {
                self.judge(notify)?;
            }
        }
        // A file with all steps is finished, so it must include its cluster scorer.
        self.score_clusters(notify)?;
        self.save()?;
        self.judge(notify)?;
        self.save()
    }

    /// Fits the cluster scorer of a finished `mluc-full` network, which separates objects from other clusters that it proposes.
    fn score_clusters(&mut self, notify: Notify) -> Result<(), TrainError> {
        if self.settings.kind == NetworkKind::MlucFull {
            let model = Model::from_bytes(&self.model()?)?;
            let set = FrameSet::open(&self.settings.data.join("train"), None, usize::MAX)?;
            // From the whole folder: it may begin with scans without synthetic unknown objects.
            let set = set.shard([0, (set.names().len() / CLUSTER_FRAMES).max(1) as u32]);
            notify(TrainEvent::Note("fitting the score of clusters".into()));
            self.cluster_scorer = fit_to_proposals(&model, &set, self.settings.seed, || ())?;
            if self.cluster_scorer.is_none() {
                let text = "clusters have no score: nothing is proposed on synthetic unknown objects, or nothing else";
                notify(TrainEvent::Note(text.into()));
            }
        }
        Ok(())
    }

    /// Starts the threads that prepare batches.
    fn begin<T: Send + 'static>(
        &mut self,
        prepare: fn(&mut DataLoader, u64) -> Result<T, TrainError>,
    ) -> Result<BatchQueue<T>, TrainError> {
        let (settings, source) = (&self.settings, self.source.clone());
        let database = std::mem::take(&mut self.database);
        let loader = DataLoader::new(settings, &self.manifest, source, database);
        Ok(loader.spawn(self.trainer.state.step..settings.steps, prepare))
    }

    /// Writes the initial network, and all batches to `to`, for [a trainer on a GPU](crate::stream). Such a run cannot be resumed.
    pub fn stream(mut self, to: &mut impl Write) -> Result<(), TrainError> {
        run_folder::refuse_other(&self.settings.out, "checkpoint.safetensors")?;
        let mut batches = self.begin(DataLoader::prepare_bytes)?;
        run_folder::write(&self.model_path(), &self.model()?)?;
        let fault = |cause: std::io::Error| TrainError::file("standard output".as_ref(), cause);
        writeln!(to, "{}", stream::header(&self.settings)).map_err(fault)?;
        for step in 0..self.settings.steps {
            to.write_all(&batches.take(step)?).map_err(fault)?;
        }
        to.flush().map_err(fault)
    }

    /// Validates the model file just written as in the paper (section 4.1: 3-D overlap, moderate, AP at 40 positions), by the inference engine; boxes
    /// without a class do not count as known objects. The figures are stored in the next file.
    fn judge(&mut self, notify: Notify) -> Result<(), TrainError> {
        let folder = self.settings.data.join("val");
        let frames = self.settings.validate_frames;
        if frames == 0 || !folder.is_dir() {
            return Ok(());
        }
        notify(TrainEvent::Note("judging on the validation scans".into()));
        let model = Model::read(&self.model_path())?;
        let set = FrameSet::open(&folder, None, frames)?;
        let mut frames = detect_frames(Precision::default(), &model, &set, || ())?;
        frames.iter_mut().for_each(DetectedFrame::drop_generic);
        let (manifest, found) = (&model.manifest, GatedObjects::ungated(&model, &frames));
        let rules = paper_rules(&manifest.name, &manifest.class_names(), &[])?;
        let report = evaluate(&found.labelled(&frames, 0), &rules);
        let mut metrics = BTreeMap::from([("validation_frames".into(), frames.len() as f64)]);
        for class in &report.classes {
            let (name, iou, figures) = (&class.rule.name, class.rule.iou_min, class.main());
            let (ap, labels) = (figures.ap.r40, figures.truth_count);
            let text = format!("{name}: AP R40 {ap:.2} at overlap {iou}, {labels} labels");
            notify(TrainEvent::Note(text));
            metrics.insert(format!("{name}/3d/moderate/ap_r40"), ap);
        }
        let (map, count) = (report.map_known().r40, frames.len());
        let text = format!("mean AP of the known classes {map:.2} on {count} frames");
        notify(TrainEvent::Note(text));
        metrics.insert("map_known".into(), map);
        self.manifest.provenance.metrics = metrics;
        Ok(())
    }

    /// Writes checkpoint and model file. For an invalid model (with non-finite values) the last good checkpoint stays.
    fn save(&self) -> Result<PathBuf, TrainError> {
        let bytes = self.model()?;
        let checkpoint = self.settings.out.join("checkpoint.safetensors");
        checkpoint::save(&checkpoint, &self.trainer.state, &self.origin)?;
        let path = self.model_path();
        run_folder::write(&path, &bytes)?;
        Ok(path)
    }

    /// The bytes of the model file.
    fn model(&self) -> Result<Vec<u8>, TrainError> {
        let (settings, state) = (&self.settings, &self.trainer.state);
        let chain = &self.trainer.chain;
        let mut manifest = self.manifest.clone();
        let data = settings.data.file_name().unwrap_or_default();
        manifest.provenance = Provenance {
            data: data.to_string_lossy().into_owned(),
            seed: settings.seed,
            steps: state.step,
            batch: settings.batch as u32,
            commit: settings.commit.clone(),
            metrics: self.manifest.provenance.metrics.clone(),
            ..Provenance::default()
        };
        let mut weights = export::weights(chain, state);
        manifest.empty_objectness_max = export::empty_objectness_max(&manifest, &weights)?;
        if let Some(scorer) = &self.cluster_scorer {
            scorer.write(&mut weights);
        }
        Ok(model_bytes(&manifest, &weights)?)
    }
}

/// Gives the anchors of each class the mean size and height of its objects. Class-agnostic anchors get the mean bottom height of the classes.
fn measure_anchors(
    manifest: &mut Manifest,
    settings: &TrainSettings,
    source: &ScanSource,
    notify: Notify,
) -> Result<(), TrainError> {
    let path = settings.data.join("train");
    let mut means = mean_boxes(source, settings.classes())?;
    if source.input == VoxelInput::Local {
        means.iter_mut().for_each(|mean| mean.bottom_z_m = 0.0);
    }
    for (class, mean) in manifest.classes.iter_mut().zip(means) {
        if mean.count == 0 {
            let expected = "objects of every class in the training split";
            let found = format!("no {}", class.name);
            return Err(refused(&path, expected, found));
        }
        (class.size_m, class.bottom_z_m) = (mean.size_m, mean.bottom_z_m);
        let ([l, w, h], bottom) = (mean.size_m, mean.bottom_z_m);
        notify(TrainEvent::Note(format!(
            "{}: {} objects, mean {l:.2} x {w:.2} x {h:.2} m, bottom at {bottom:.2} m",
            class.name, mean.count
        )));
    }
    let count = manifest.classes.len().max(1) as f32;
    let bottom_z_m = manifest.classes.iter().map(|c| c.bottom_z_m).sum::<f32>() / count;
    for anchor in &mut manifest.generic {
        anchor.bottom_z_m = bottom_z_m;
    }
    let in_file = |cause: ModelError| ModelError::InFile(path, cause.into());
    Ok(manifest.validate().map_err(in_file)?)
}
