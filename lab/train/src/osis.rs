//! Trains the point embedding of the OSIS baseline on the frozen trunk of a softmax network; one frame per step.
//!
//! Training takes minutes, so an interrupted run starts again; a finished run is left unchanged.

use crate::error::{TrainError, diverged, refused};
use crate::log::{Log, Progress, TrainEvent};
use crate::optimizer::{Adam, Schedule};
use crate::{check, embedding::FrameFeatures, embedding::PointEmbedding, run_folder};
use crate::{import::model_path, scan::LabelledScan, settings::TrainSettings, source::ScanSource};
use mluc_backbone::Backbone;
use mluc_geometry::{Inside, Random};
use mluc_model::{HeadKind, Model, VoxelInput, model_bytes};
use std::path::PathBuf;

/// Number of points of an instance in a step.
const INSTANCE_POINTS: usize = 48;
/// Number of background points in a step.
const BACKGROUND_POINTS: usize = 1024;
/// Chance that an instance has no prototype.
const HELD_OUT: f64 = 0.2;

/// Trains and writes the model; returns its path. `settings.init`: the softmax network.
pub fn train_osis(
    settings: &TrainSettings,
    notify: &mut dyn FnMut(TrainEvent),
) -> Result<PathBuf, TrainError> {
    let expected = "a softmax network for osis to stand on";
    let wrong = |found: &str| refused("--init".as_ref(), expected, found);
    let init = settings.init.as_ref().ok_or_else(|| wrong("nothing"))?;
    let mut model = Model::read(&model_path(init))?;
    let network = &model.manifest.network;
    if network.head != HeadKind::Softmax {
        return Err(wrong(&format!("a {:?} head", network.head)));
    }
    let (own, setting) = (&model.manifest.name, settings.setting.name());
    if own != setting {
        return Err(wrong(&format!("one of --setting {own} for --setting {setting}")));
    }
    // One frame per step, regardless of --batch.
    let settings = &TrainSettings { batch: 1, ..settings.clone() };
    let _lock = run_folder::enter(&settings.out)?;
    let out = settings.out.join("model.safetensors");
    let channels = network.feature_channels();
    let data = settings.data.file_name().unwrap_or_default();
    let data = data.to_string_lossy();
    let is_done = |found: Model| {
        let from = &found.manifest.provenance;
        let mut trunk = model.weights.iter();
        (from.steps, from.seed, &*from.data) == (settings.steps, settings.seed, &*data)
            && trunk.all(|tensor| found.weights.iter().any(|other| other == tensor))
            && PointEmbedding::read(&found.weights, channels).is_some()
    };
    if out.is_file() && Model::read(&out).is_ok_and(is_done) {
        notify(TrainEvent::Note("already trained".into()));
        return Ok(out);
    }
    run_folder::refuse_other(&settings.out, "model.safetensors")?;
    run_folder::refuse_other(&settings.out, "checkpoint.safetensors")?;
    fit(&model, settings, notify)?.write(&mut model.weights);
    let provenance = &mut model.manifest.provenance;
    (provenance.steps, provenance.seed) = (settings.steps, settings.seed);
    (provenance.data, provenance.batch) = (data.into_owned(), 1);
    provenance.commit.clone_from(&settings.commit);
    provenance.metrics.clear();
    run_folder::write(&out, &model_bytes(&model.manifest, &model.weights)?)?;
    Ok(out)
}

fn fit(
    model: &Model,
    settings: &TrainSettings,
    notify: &mut dyn FnMut(TrainEvent),
) -> Result<PointEmbedding, TrainError> {
    let manifest = &model.manifest;
    let source = ScanSource {
        dataset: check::training_split(settings)?,
        classes: manifest.class_names(),
        takes_synthetic_unknown: false,
        // The backbone estimates the ground itself.
        input: VoxelInput::Absolute,
    };
    check::points(&source, settings)?;
    let mut backbone = Backbone::new(manifest, &model.weights)?;
    let mut embedding = PointEmbedding::new(manifest.network.feature_channels(), settings.seed);
    let mut adam = Adam::new(embedding.mlp.parameters.len());
    let schedule = Schedule::new(settings.learning_rate, settings.steps);
    let mut log = Log::open(settings, false)?;
    for step in 0..settings.steps {
        let mut random = Random::new(settings.seed, &[0x0515, step]);
        let scan = source.scan(random.below(source.count()))?;
        backbone.run(&scan.points);
        let (cells, rows) = backbone.last_rows()?;
        let features = FrameFeatures::new(manifest, &cells, &rows);
        let (input, owner, instances) = sample(&scan, &features, &mut random);
        let held_out = (0..instances).map(|_| random.uniform(0.0, 1.0) < HELD_OUT);
        let held_out: Vec<bool> = held_out.collect();
        let (loss, gradient) = embedding.step(input, &owner, &held_out);
        if !loss.is_finite() {
            return Err(diverged(step, loss));
        }
        let (rate, momentum) = schedule.at(step);
        let parameters = &mut embedding.mlp.parameters;
        let mut progress = Progress {
            step: step + 1,
            loss,
            gradient_norm: adam.step(parameters, &gradient, (rate, momentum)),
            rate,
            ..Progress::default()
        };
        progress.losses.metric = loss;
        if let Some(line) = log.add(progress)? {
            notify(TrainEvent::Progress(&line));
        }
    }
    Ok(embedding)
}

/// Features of some points of every known object and of the background, their owners, and the number of objects. Points
/// on other labelled objects are left out.
fn sample(
    scan: &LabelledScan,
    features: &FrameFeatures,
    random: &mut Random,
) -> (Vec<f32>, Vec<Option<usize>>, usize) {
    let tests: Vec<Inside> = scan.objects.iter().map(|o| Inside::of(&o.bounds, 0.0)).collect();
    let mut of_object: Vec<Vec<usize>> = vec![vec![]; tests.len()];
    let mut background = vec![];
    for (i, point) in scan.points.iter().enumerate() {
        match tests.iter().position(|test| test.has_point(point)) {
            Some(object) => of_object[object].push(i),
            None => background.push(i),
        }
    }
    let (mut input, mut owner, mut instances) = (vec![], vec![], 0);
    let mut take = |from: &[usize], count: usize, of: Option<usize>| -> usize {
        let mut shuffled: Vec<u32> = (0..from.len() as u32).collect();
        random.shuffle(&mut shuffled);
        let before = owner.len();
        for i in shuffled.into_iter().take(count) {
            let [x, y, z, _] = scan.points[from[i as usize]];
            if features.append([x, y, z], &mut input) {
                owner.push(of);
            }
        }
        owner.len() - before
    };
    let objects = scan.objects.iter().zip(of_object);
    for (_, points) in objects.filter(|(o, _)| o.trained_class().is_some()) {
        if take(&points, INSTANCE_POINTS, Some(instances)) > 0 {
            instances += 1;
        }
    }
    take(&background, BACKGROUND_POINTS, None);
    (input, owner, instances)
}
