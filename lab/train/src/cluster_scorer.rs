//! Fits the layers that score how much a cluster is like a thing that a robot must heed (`mluc_refiner::ClusterScorer`), on scans with
//! synthetic unknown objects.
//!
//! The network goes first: what it and the refiner would publish as unknown is judged, on a synthetic unknown object or not. So the layers
//! learn to tell objects from the very background that the network is wrong about. No label of an unknown class is used. Sizes are varied
//! while they are fitted. Extension of the paper.

use mluc_backbone::Precision;
use mluc_dataset::SYNTHETIC_UNKNOWN;
use mluc_evaluate::pipeline::{DetectedFrame, FrameSet, ModelGate, detect_frames};
use mluc_geometry::{Box3, Random, intersection_over_min_area, iou_3d};
use mluc_model::{CLUSTER_SCORER_WIDTHS, Model};
use mluc_refiner::cluster_scorer::{FEATURES, features};
use mluc_refiner::{ClusterScorer, Refiner, RefinerError, RefinerOutput, Sensor, Settings};
use rayon::prelude::*;

use crate::error::TrainError;
use crate::mlp::Mlp;
use crate::optimizer::{Adam, Schedule};

const STEPS: u64 = 400;
/// Clusters of a step, and those of them on objects: far more of what is proposed is background.
const BATCH: usize = 1024;
const BATCH_OBJECTS: usize = 102;
/// Log of the factor by which sizes are varied, standard deviation.
const SIZE_DEVIATION: f64 = 0.3;
/// A box with a higher overlap is on the object, as evaluation has it; one with less than this share of the smaller footprint is not.
const IOU_ON: f64 = 0.1;
const SHARE_OFF: f64 = 0.02;
/// P(unknown) from which a box is a candidate here, below the thresholds of models, which are chosen later.
const UNKNOWN_MIN: f32 = 0.5;

/// Fits on the frames of a set whose labels have synthetic unknown objects; `step` is called after each.
pub fn fit_cluster_scorer(
    model: &Model,
    set: &FrameSet,
    seed: u64,
    step: impl FnMut(),
) -> Result<ClusterScorer, TrainError> {
    let frames = detect_frames(Precision::default(), model, set, step)?;
    let sensor = Sensor::from_manifest(&model.manifest)?;
    let refiner = || Refiner::new(Settings::default(), &sensor);
    let of_frame = |refiner: &mut Result<Refiner, RefinerError>, (number, frame)| {
        let refiner = refiner.as_mut().map_err(|fault| fault.clone())?;
        examples(refiner, ModelGate::of(model), set, number, frame)
    };
    let frames = frames.par_iter().enumerate().map_init(refiner, of_frame);
    let examples = frames.collect::<Result<Vec<_>, TrainError>>()?.concat();
    let objects = examples.iter().filter(|example| example.1).count();
    if objects == 0 || objects == examples.len() {
        let (found, data) = (examples.len(), set.describe());
        return Err(TrainError::Stopped(format!(
            "{data}: expected candidates of the network on synthetic unknown objects (simulate --synthetic-unknown) and on nothing, found {objects} of {found} on them"
        )));
    }
    Ok(as_scorer(fit(&examples, seed)))
}

/// The layers as the refiner runs them: both lay them out alike.
fn as_scorer(mlp: Mlp) -> ClusterScorer {
    ClusterScorer::new(mlp.parameters).expect("the widths are those of the model file")
}

/// Features, and whether it is an object.
type Example = ([f32; FEATURES], bool);

/// Of what is published as unknown in a frame when everything is.
fn examples(
    refiner: &mut Refiner,
    gate: ModelGate,
    set: &FrameSet,
    number: usize,
    frame: &DetectedFrame,
) -> Result<Vec<Example>, TrainError> {
    let calibration = &frame.truth.calibration;
    let labels = frame.truth.labels.iter();
    let labels = labels.filter(|label| label.is(SYNTHETIC_UNKNOWN));
    let in_sensor = labels.map(|label| calibration.box_in_sensor_from_label(&label.camera_box));
    let synthetic: Vec<Box3> = in_sensor.collect();
    let mut refined = RefinerOutput::default();
    let gated = frame.gated(gate, 1.0 - UNKNOWN_MIN);
    refiner.refine(number as u64, &set.points(number)?, &gated, &mut refined);
    let objects = refined.objects.iter().zip(&refined.measures);
    let example = |(object, measures): (&mluc_ipc_types::Object, &Option<_>)| {
        let measures = measures.as_ref().filter(|_| object.is_published())?;
        let shape = Box3::from_f32(object.center_m, object.size_m, object.yaw_rad);
        let most = |overlap: fn(&Box3, &Box3) -> f64| {
            let overlaps = synthetic.iter().map(|bounds| overlap(&shape, bounds));
            overlaps.fold(0.0, f64::max)
        };
        let is_object = most(iou_3d) > IOU_ON;
        let is_nothing = most(intersection_over_min_area) < SHARE_OFF;
        (is_object || is_nothing).then(|| (features(measures), is_object))
    };
    Ok(objects.filter_map(example).collect())
}

/// Logistic loss.
fn fit(examples: &[Example], seed: u64) -> Mlp {
    let mut random = Random::new(seed, &[0xC1]);
    let mut mlp = Mlp::new(&CLUSTER_SCORER_WIDTHS, &mut random);
    let (objects, rest): (Vec<&Example>, Vec<&Example>) = examples.iter().partition(|e| e.1);
    let mut adam = Adam::new(mlp.parameters.len());
    let schedule = Schedule::new(0.02, STEPS);
    for step in 0..STEPS {
        let mut input = Vec::with_capacity(BATCH * FEATURES);
        for i in 0..BATCH {
            let list = if i < BATCH_OBJECTS { &objects } else { &rest };
            let mut values = list[random.below(list.len())].0;
            let sizes = values[..3].iter_mut();
            sizes.for_each(|v| *v += (SIZE_DEVIATION * random.normal()) as f32);
            input.extend(values);
        }
        let trace = mlp.forward(input);
        let gradient = trace.output().iter().enumerate().map(|(i, x)| {
            let p = 1.0 / (1.0 + (-x).exp());
            (p - if i < BATCH_OBJECTS { 1.0 } else { 0.0 }) / BATCH as f32
        });
        let gradient = mlp.backward(&trace, gradient.collect());
        adam.step(&mut mlp.parameters, &gradient, schedule.at(step));
    }
    mlp
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bodies_and_leaves_are_told_apart() {
        let mut random = Random::new(2, &[]);
        let mut draw = |is_object: bool| {
            let mut f = [0; FEATURES].map(|_| random.normal() as f32);
            // Leaves scatter; sizes say nothing.
            f[7] += if is_object { -3.0 } else { 3.0 };
            (f, is_object)
        };
        let examples: Vec<Example> = (0..600).map(|i| draw(i % 3 == 0)).collect();
        let mlp = fit(&examples, 1);
        let logits = examples
            .iter()
            .map(|(f, _)| mlp.forward(f.to_vec()).output()[0]);
        let logits: Vec<f32> = logits.collect();
        let right = examples.iter().zip(&logits);
        let right = right.filter(|((_, is_object), x)| (**x > 0.0) == *is_object);
        assert!(right.count() > 560);
        // The vehicle's forward pass gives the same.
        let scorer = as_scorer(mlp);
        for ((f, _), x) in examples.iter().zip(&logits) {
            assert_eq!(scorer.logit(f), *x);
        }
    }
}
