//! Fits the layers that score the similarity of a cluster to an object (`mluc_refiner::ClusterScorer`), on training scans only: proposals of a trained
//! network on synthetic unknown objects are the positives, its proposals elsewhere the negatives.
//!
//! Sizes are varied during the fit, so that the scorer separates bodies from walls and leaves instead of learning sizes. Extension of the paper.

use crate::optimizer::{Adam, Schedule};
use crate::{error::TrainError, mlp::Mlp, source::stands_for_unknown};
use mluc_backbone::Precision;
use mluc_dataset::Label;
use mluc_evaluate::pipeline::{DetectedFrame, FrameSet, ModelGate, detect_frames};
use mluc_geometry::{Box3, Random, intersection_over_min_area, iou_3d};
use mluc_ipc_types::Object;
use mluc_model::{CLUSTER_SCORER_WIDTHS, Model};
use mluc_refiner::{ClusterScorer, Refiner, RefinerError, RefinerOutput, Sensor, Settings};
use mluc_refiner::{cluster_scorer::FEATURES, cluster_scorer::features, clusters::Measures};
use rayon::prelude::*;

const STEPS: u64 = 400;
/// Clusters per step, and the number of objects among them: a tenth, since most proposals are background.
const BATCH: usize = 1024;
const OBJECTS: usize = 102;
/// Standard deviation of the log of the factor by which sizes are varied.
const SIZE_DEVIATION: f64 = 0.3;
/// A proposed box is on an object above this overlap, as in evaluation; it is on nothing when its share on every object is below `SHARE_OFF`.
const IOU_ON: f64 = 0.1;
const SHARE_OFF: f64 = 0.02;
/// P(unknown) from which a box is proposed here: the minimum of a model's threshold.
const UNKNOWN_MIN: f32 = 0.5;

/// Fits on the proposals of a trained network with an unknown output, on scans with synthetic unknown objects; `step` is called after each scan.
/// `None` where it proposes nothing on these objects, or nothing elsewhere.
pub fn fit_to_proposals(
    model: &Model,
    set: &FrameSet,
    seed: u64,
    step: impl FnMut(),
) -> Result<Option<ClusterScorer>, TrainError> {
    let frames = detect_frames(Precision::default(), model, set, step)?;
    let sensor = Sensor::from_manifest(&model.manifest);
    let refiner = || Refiner::new(Settings::default(), &sensor);
    let classes = model.manifest.class_names();
    let of_frame = |refiner: &mut Result<Refiner, RefinerError>, (number, frame)| {
        let refiner = refiner.as_mut().map_err(|fault| fault.clone())?;
        proposed(refiner, set, number, frame, &classes)
    };
    let frames = frames.par_iter().enumerate().map_init(refiner, of_frame);
    let examples = frames.collect::<Result<Vec<_>, TrainError>>()?.concat();
    Ok(fit(&examples, seed).map(as_scorer))
}

/// Examples from the published unknown objects of a frame, at the lowest threshold.
fn proposed(
    refiner: &mut Refiner,
    set: &FrameSet,
    number: usize,
    frame: &DetectedFrame,
    classes: &[String],
) -> Result<Vec<Example>, TrainError> {
    let calibration = &frame.truth.calibration;
    let in_sensor = |label: &Label| calibration.box_in_sensor_from_label(&label.camera_box);
    let (mut synthetic, mut others) = (vec![], vec![]);
    for label in frame.truth.labels.iter() {
        if stands_for_unknown(label, classes) {
            synthetic.push(in_sensor(label));
        } else if !label.is_dont_care() && !classes.iter().any(|class| label.is(class)) {
            others.push(in_sensor(label));
        }
    }
    let mut refined = RefinerOutput::default();
    let gated = frame.gated(ModelGate::Known, 1.0 - UNKNOWN_MIN);
    refiner.refine(number as u64, &set.points(number)?, &gated, &mut refined);
    let objects = refined.objects.iter().zip(&refined.measures);
    // Sizes that no road user has are ranked without the layers.
    let is_scored = |object: &Object| {
        let has_size = object.flags & (Object::SMALL | Object::LARGE | Object::POST) == 0;
        object.is_published() && has_size
    };
    let example = |(object, measures): (&Object, &Option<Measures>)| {
        let measures = measures.as_ref().filter(|_| is_scored(object))?;
        let shape = Box3::from_f32(object.center_m, object.size_m, object.yaw_rad);
        let is_object = synthetic.iter().any(|own| iou_3d(&shape, own) > IOU_ON);
        // Proposals on other labelled objects, which are neither learned nor unknown, are not used.
        let is_off = |bounds: &Box3| intersection_over_min_area(&shape, bounds) < SHARE_OFF;
        let is_nothing = synthetic.iter().chain(&others).all(is_off);
        (is_object || is_nothing).then(|| (features(measures), is_object))
    };
    Ok(objects.filter_map(example).collect())
}

/// The layers in the refiner's form: the memory layout is the same.
fn as_scorer(mlp: Mlp) -> ClusterScorer {
    ClusterScorer::new(mlp.parameters).expect("the widths are those of the model file")
}

/// Features, and whether the cluster is an object.
type Example = ([f32; FEATURES], bool);

/// Fits with the logistic loss.
fn fit(examples: &[Example], seed: u64) -> Option<Mlp> {
    let mut random = Random::new(seed, &[0xC1]);
    let mut mlp = Mlp::new(&CLUSTER_SCORER_WIDTHS, &mut random);
    let (objects, rest): (Vec<&Example>, Vec<&Example>) = examples.iter().partition(|e| e.1);
    if objects.is_empty() || rest.is_empty() {
        return None;
    }
    let mut adam = Adam::new(mlp.parameters.len());
    let schedule = Schedule::new(0.02, STEPS);
    for step in 0..STEPS {
        let mut input = Vec::with_capacity(BATCH * FEATURES);
        for i in 0..BATCH {
            let list = if i < OBJECTS { &objects } else { &rest };
            let mut values = list[random.below(list.len())].0;
            values[..3].iter_mut().for_each(|v| *v += (SIZE_DEVIATION * random.normal()) as f32);
            input.extend(values);
        }
        let trace = mlp.forward(input);
        let gradient = trace.output().iter().enumerate().map(|(i, x)| {
            let p = 1.0 / (1.0 + (-x).exp());
            (p - if i < OBJECTS { 1.0 } else { 0.0 }) / BATCH as f32
        });
        let gradient = mlp.backward(&trace, gradient.collect());
        adam.step(&mut mlp.parameters, &gradient, schedule.at(step));
    }
    Some(mlp)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bodies_and_leaves_are_told_apart() {
        let mut random = Random::new(2, &[]);
        let mut draw = |is_object: bool| {
            let mut f = [0; FEATURES].map(|_| random.normal() as f32);
            // Leaves scatter; sizes give no information.
            f[7] += if is_object { -2.0 } else { 2.0 };
            (f, is_object)
        };
        let examples: Vec<Example> = (0..600).map(|i| draw(i % 3 == 0)).collect();
        assert_eq!(fit(&examples[..1], 1), None);
        let mlp = fit(&examples, 1).expect("layers");
        let logit = |(f, _): &Example| mlp.forward(f.to_vec()).output()[0];
        let logits: Vec<f32> = examples.iter().map(logit).collect();
        let right = examples.iter().zip(&logits);
        let right = right.filter(|((_, is_object), x)| (**x > 0.0) == *is_object);
        assert!(right.count() > 560);
        // The vehicle's forward pass gives the same logits.
        let scorer = as_scorer(mlp);
        for ((f, _), x) in examples.iter().zip(&logits) {
            assert_eq!(scorer.logit(f), *x);
        }
        let mut weights = mluc_model::WeightSet::new();
        scorer.write(&mut weights);
        assert_eq!(ClusterScorer::of_model(&weights), Some(scorer));
    }
}
