//! Fits the layers that score how much a cluster is like something that drives or walks (`mluc_refiner::ClusterScorer`) on the training
//! split alone, where clusters on labelled objects of the known classes stand against clusters on nothing.
//!
//! Sizes are varied while it is fitted, so that it learns bodies against walls and leaves rather than the sizes of the known
//! classes. Extension of the paper.

use mluc_geometry::{Box3, Random, intersection_bev_m2};
use mluc_ipc_types::Point;
use mluc_model::{CLUSTER_SCORER_WIDTHS, Manifest};
use mluc_refiner::cluster_scorer::{FEATURES, features};
use mluc_refiner::clusters::FrameCluster;
use mluc_refiner::{ClusterScorer, FrameClusterer, FrameClusters, Sensor, Settings};
use rayon::prelude::*;

use crate::error::TrainError;
use crate::mlp::Mlp;
use crate::optimizer::{Adam, Schedule};
use crate::source::ScanSource;

const STEPS: u64 = 400;
/// Clusters of a step.
const BATCH: usize = 2048;
/// Log of the factor by which sizes are varied, standard deviation.
const SIZE_DEVIATION: f64 = 0.3;
/// Shares of a cluster that lie on a label: above the first it is that object, below the second nothing.
const SHARE_ON: f64 = 0.3;
const SHARE_OFF: f64 = 0.02;

/// Fits on the first `frames` scans.
pub fn fit_cluster_scorer(
    source: &ScanSource,
    manifest: &Manifest,
    frames: usize,
    seed: u64,
) -> Result<ClusterScorer, TrainError> {
    let sensor = Sensor::from_manifest(manifest)?;
    let frames = (0..frames.min(source.count())).into_par_iter();
    let examples = frames.map(|frame| examples(source, &sensor, frame));
    let examples: Vec<Vec<Example>> = examples.collect::<Result<_, TrainError>>()?;
    Ok(as_scorer(fit(&examples.concat(), seed)))
}

/// The layers as the refiner runs them: both lay them out alike.
fn as_scorer(mlp: Mlp) -> ClusterScorer {
    ClusterScorer::new(mlp.parameters).expect("the widths are those of the model file")
}

/// Features, and whether it is an object.
type Example = ([f32; FEATURES], bool);

fn examples(
    source: &ScanSource,
    sensor: &Sensor,
    frame: usize,
) -> Result<Vec<Example>, TrainError> {
    let scan = source.scan(frame)?;
    let points: &[Point] = bytemuck::cast_slice(&scan.points);
    let mut found = FrameClusters::default();
    FrameClusterer::new(&Settings::default(), sensor)?.find(points, &mut found);
    let example = |cluster: &FrameCluster| {
        let area = |b: &Box3| b.size_m[0] * b.size_m[1];
        let share = |bounds: &Box3| {
            let smaller = area(&cluster.shape).min(area(bounds)).max(1e-9);
            intersection_bev_m2(&cluster.shape, bounds) / smaller
        };
        let on = |known: bool| {
            let objects = scan.objects.iter();
            let objects = objects.filter(|o| o.trained_class().is_some() == known);
            objects.map(|o| share(&o.bounds)).fold(0.0, f64::max)
        };
        let (known, other) = (on(true), on(false));
        let is_object = known > SHARE_ON;
        let is_nothing = known < SHARE_OFF && other < SHARE_OFF;
        (is_object || is_nothing).then(|| (features(&cluster.measures), is_object))
    };
    Ok(found.clusters.iter().filter_map(example).collect())
}

/// Logistic loss; objects and the rest weigh the same.
fn fit(examples: &[Example], seed: u64) -> Mlp {
    let mut random = Random::new(seed, &[0xC1]);
    let mut mlp = Mlp::new(&CLUSTER_SCORER_WIDTHS, &mut random);
    let (objects, rest): (Vec<&Example>, Vec<&Example>) = examples.iter().partition(|e| e.1);
    if objects.is_empty() || rest.is_empty() {
        return mlp;
    }
    let mut adam = Adam::new(mlp.parameters.len());
    let schedule = Schedule::new(0.02, STEPS);
    for step in 0..STEPS {
        let mut input = Vec::with_capacity(BATCH * FEATURES);
        for i in 0..BATCH {
            let list = if i % 2 == 0 { &objects } else { &rest };
            let mut values = list[random.below(list.len())].0;
            let sizes = values[..3].iter_mut();
            sizes.for_each(|v| *v += (SIZE_DEVIATION * random.normal()) as f32);
            input.extend(values);
        }
        let trace = mlp.forward(input);
        let gradient = trace.output().iter().enumerate().map(|(i, x)| {
            let p = 1.0 / (1.0 + (-x).exp());
            (p - if i % 2 == 0 { 1.0 } else { 0.0 }) / BATCH as f32
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
            f[7] += if is_object { -2.0 } else { 2.0 };
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
