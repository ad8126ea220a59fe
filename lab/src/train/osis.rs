//! Trains the point embedding of the OSIS baseline on the frozen trunk of a softmax network; one frame a step.
//!
//! It takes minutes, so an interrupted run starts anew; a finished one is left as it is.

use std::path::PathBuf;
use std::time::Instant;

use mluc_backbone::Backbone;
use mluc_model::{HeadKind, Model, model_bytes};

use super::check;
use super::checkpoint::write_atomically;
use super::embedding::{FrameFeatures, PointEmbedding};
use super::error::TrainError;
use super::folder;
use super::log::Log;
use super::losses::Losses;
use super::optimizer::{Adam, Schedule};
use super::random::Random;
use super::run::Event;
use super::scene::{InBox, Scene};
use super::settings::Settings;
use super::source::{FolderSource, Source};
use super::trainer::{Report, Timing};

/// Points of an instance that a step looks at.
const INSTANCE_POINTS: usize = 48;
/// Background points that a step looks at.
const BACKGROUND_POINTS: usize = 1024;
/// Chance that an instance has no prototype.
const HELD_OUT: f64 = 0.2;

/// Trains and writes the model; returns its path. `settings.init`: the softmax network.
pub fn train_osis(settings: &Settings, tell: &mut dyn FnMut(Event)) -> Result<PathBuf, TrainError> {
    settings.check()?;
    let init = settings.init.clone().ok_or(TrainError::Setting {
        name: "--init",
        expected: "a softmax network for osis to stand on",
        found: "nothing".into(),
    })?;
    let init = if init.is_dir() {
        init.join("model.safetensors")
    } else {
        init
    };
    let mut model = Model::read(&init)?;
    if model.manifest.network.head != HeadKind::Softmax {
        return Err(TrainError::Setting {
            name: "--init",
            expected: "a softmax network for osis to stand on",
            found: format!("a {:?} head", model.manifest.network.head),
        });
    }
    let _lock = folder::enter(&settings.out)?;
    let out = settings.out.join("model.safetensors");
    let channels = model.manifest.network.feature_channels();
    let is_done = |found: &Model| {
        let from = &found.manifest.provenance;
        let mut trunk = model.weights.iter();
        (from.steps, from.seed) == (settings.steps, settings.seed)
            && trunk.all(|tensor| found.weights.iter().any(|other| other == tensor))
            && PointEmbedding::read(&found.weights, channels).is_some()
    };
    if out.is_file() && Model::read(&out).is_ok_and(|found| is_done(&found)) {
        tell(Event::Note("already trained".into()));
        return Ok(out);
    }
    folder::refuse_other(&settings.out, "model.safetensors")?;
    folder::refuse_other(&settings.out, "checkpoint.safetensors")?;
    let embedding = fit(&model, settings, tell)?;
    embedding.write(&mut model.weights);
    model.manifest.provenance.steps = settings.steps;
    model.manifest.provenance.seed = settings.seed;
    write_atomically(&out, &model_bytes(&model.manifest, &model.weights)?)?;
    Ok(out)
}

fn fit(
    model: &Model,
    settings: &Settings,
    tell: &mut dyn FnMut(Event),
) -> Result<PointEmbedding, TrainError> {
    let manifest = &model.manifest;
    let names = manifest.classes.iter().map(|c| c.name.clone()).collect();
    let source = FolderSource::new(check::training_split(settings)?, names);
    check::points(&source, settings)?;
    let mut backbone = Backbone::new(manifest, &model.weights)?;
    let mut embedding = PointEmbedding::new(manifest.network.feature_channels(), settings.seed);
    let mut all = flat(&embedding);
    let mut adam = Adam::new(all.len());
    let schedule = Schedule {
        rate_max: settings.learning_rate,
        steps: settings.steps,
    };
    let mut log = Log::open(&settings.out.join("train.jsonl"), settings, false)?;
    let (mut cells, mut rows) = (vec![], vec![]);
    for step in 0..settings.steps {
        let clock = Instant::now();
        let mut random = Random::new(settings.seed, &[0x0515, step]);
        let scene = source.scene(random.below(source.count()))?;
        let frame = backbone.run(&scene.points);
        cells.resize(frame.rows, 0);
        rows.resize(frame.rows * backbone.feature_channels(), 0.0);
        backbone.write_rows(&mut cells, &mut rows)?;
        let features = FrameFeatures::new(manifest, &cells, &rows);
        let (input, owner, instances) = sample(&scene, &features, &mut random);
        let held_out: Vec<bool> = (0..instances)
            .map(|_| random.uniform(0.0, 1.0) < HELD_OUT)
            .collect();
        let trace = embedding.mlp.forward(input);
        let loss = embedding.loss(trace.output(), &owner, &held_out);
        if !loss.value.is_finite() {
            return Err(TrainError::Diverged {
                step,
                found: loss.value,
            });
        }
        let mut gradient = embedding.mlp.backward(&trace, loss.embedding);
        gradient.extend(loss.background.iter().chain([&loss.unknown]));
        let at = schedule.at(step);
        let gradient_norm = adam.step(&mut all, &gradient, at);
        unflatten(&all, &mut embedding);
        let report = Report {
            losses: Losses {
                metric: loss.value,
                ..Losses::default()
            },
            gradient_norm,
            rate: at.0,
            timing: Timing {
                forward: 1e3 * clock.elapsed().as_secs_f64(),
                ..Timing::default()
            },
        };
        if let Some(progress) = log.add(&report, step + 1)? {
            tell(Event::Progress(&progress));
        }
    }
    Ok(embedding)
}

fn flat(embedding: &PointEmbedding) -> Vec<f32> {
    let rest = embedding.background.iter().chain([&embedding.unknown]);
    embedding
        .mlp
        .parameters
        .iter()
        .chain(rest)
        .copied()
        .collect()
}

fn unflatten(all: &[f32], embedding: &mut PointEmbedding) {
    let (mlp, rest) = all.split_at(embedding.mlp.parameters.len());
    let (background, unknown) = rest.split_at(embedding.background.len());
    embedding.mlp.parameters.copy_from_slice(mlp);
    embedding.background.copy_from_slice(background);
    embedding.unknown = unknown[0];
}

/// Features of some points of every known object and of the background, their owners, and how many objects there are. Points
/// of other labelled objects are left out.
fn sample(
    scene: &Scene,
    features: &FrameFeatures,
    random: &mut Random,
) -> (Vec<f32>, Vec<Option<usize>>, usize) {
    let tests: Vec<InBox> = scene
        .objects
        .iter()
        .map(|o| InBox::new(&o.bounds))
        .collect();
    let mut of_object: Vec<Vec<usize>> = vec![vec![]; tests.len()];
    let mut background = vec![];
    for (i, point) in scene.points.iter().enumerate() {
        match tests.iter().position(|test| test.contains(point)) {
            Some(object) => of_object[object].push(i),
            None => background.push(i),
        }
    }
    let known = scene.objects.iter().zip(of_object);
    let known = known
        .filter(|(o, _)| o.trained_class().is_some())
        .map(|(_, points)| points);
    let (mut input, mut owner, mut instances) = (vec![], vec![], 0);
    let mut take = |mut from: Vec<usize>, count: usize, of: Option<usize>| -> usize {
        let mut shuffled: Vec<u32> = (0..from.len() as u32).collect();
        random.shuffle(&mut shuffled);
        from = shuffled
            .iter()
            .take(count)
            .map(|i| from[*i as usize])
            .collect();
        let before = owner.len();
        for i in from {
            let [x, y, z, _] = scene.points[i];
            if features.append([x, y, z], &mut input) {
                owner.push(of);
            }
        }
        owner.len() - before
    };
    for points in known {
        if take(points, INSTANCE_POINTS, Some(instances)) > 0 {
            instances += 1;
        }
    }
    take(background, BACKGROUND_POINTS, None);
    (input, owner, instances)
}
