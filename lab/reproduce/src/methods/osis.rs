//! The modified OSIS: clusters of points outside known boxes and above the ground (Wong et al., CoRL 2019, as the paper uses it in section 4.4).
//!
//! A point is unknown only if every box around it is below the threshold; points in no box qualify too, so trees and walls do.
//! `osis-geo` clusters points only by position; `osis` also by a learned embedding, which also removes points that it takes for background.

use super::osis_embedding::{Embedder, Standing};
use super::{MethodInput, dbscan::Group, dbscan::cluster};
use crate::Result;
use mluc_evaluate::SensorDetection;
use mluc_evaluate::pipeline::{GatedObjects, ModelGate, box_of};
use mluc_geometry::{Box3, Inside, ground::GroundGrid, ground::ground_height_m};
use mluc_head::Detection;
use mluc_ipc_types::Point;
use mluc_refiner::fit::{ClusterPoints, minimum_area};
use rayon::prelude::*;
use std::{collections::BTreeMap, f64::consts::FRAC_PI_2};

/// Number of thresholds besides the closed set: each one needs a clustering of every frame.
const THRESHOLDS: usize = 20;
/// Points are thinned to one per cube of this edge, m: the clustering's reach is much larger.
const THIN_M: f32 = 0.2;
/// Points with less height than this above the ground belong to the ground, m.
const CLEARANCE_M: f32 = 0.2;
/// Minimum number of thinned points in a cluster.
const POINTS_MIN: usize = 5;
/// Longer clusters would match no label; they are left out to save the time for their boxes, m.
const LENGTH_MAX_M: f64 = 20.0;

pub(super) fn run(input: &MethodInput, learned: bool) -> Result<GatedObjects> {
    let thresholds = input.thresholds(ModelGate::Softmax, input.frames, THRESHOLDS);
    let classes = input.model.manifest.class_names();
    let height_m = f64::from(input.model.manifest.sensor_height_m);
    let embedder = learned.then(|| Embedder::new(input.model)).transpose()?;
    let one_frame = |ground: &mut GroundGrid, frame: usize| {
        let points = input.set.points(frame)?;
        let detections = &input.frames[frame].detections;
        let mut standing = standing(ground, &points, detections);
        if let Some(embedder) = &embedder {
            embedder.embed(&points, &mut standing)?;
        }
        let at = |threshold: &f64| {
            let boxes = detections.iter().filter(|d| f64::from(d.softmax_max) >= *threshold);
            let known = boxes.map(|d| SensorDetection::of_box(d, &classes));
            let mut objects: Vec<SensorDetection> = known.collect();
            if *threshold > 0.0 {
                objects.extend(unknown(&standing, *threshold as f32, embedder.as_ref()));
            }
            objects
        };
        (input.step)();
        Ok(thresholds.iter().map(at).collect())
    };
    let frames = (0..input.frames.len()).into_par_iter();
    let objects = frames.map_init(|| GroundGrid::new(height_m), one_frame);
    let objects: Result<Vec<_>> = objects.collect();
    Ok(GatedObjects { objects: objects?, thresholds })
}

/// One point per cube of the points above the ground, in the order of their cubes.
fn standing(ground: &mut GroundGrid, points: &[Point], detections: &[Detection]) -> Vec<Standing> {
    let ground_m = ground.find(bytemuck::cast_slice(points));
    let mut cubes: BTreeMap<[i32; 3], [f32; 3]> = BTreeMap::new();
    for p in points {
        let at = [p.x_m, p.y_m, p.z_m];
        let cube = at.map(|v| (v / THIN_M).floor() as i32);
        cubes.entry(cube).or_insert(at);
    }
    let test = |d: &Detection| (Inside::of(&box_of(d), 0.0), d.softmax_max);
    let tests: Vec<(Inside, f32)> = detections.iter().map(test).collect();
    let stands = |&[x, y, z]: &[f32; 3]| z - ground_height_m(ground_m, [x, y]) > CLEARANCE_M;
    let point = |at_m: [f32; 3]| {
        let [x, y, z] = at_m;
        let around = tests.iter().enumerate();
        let around = around.filter(|(_, (test, _))| test.has_point(&[x, y, z, 0.0]));
        let best = around.map(|(i, (_, p))| (i, *p)).reduce(|a, b| if b.1 > a.1 { b } else { a });
        Standing {
            at_m,
            known: best.map_or(0.0, |(_, p)| p),
            inside: best.map(|(i, _)| i),
            embedding: vec![],
        }
    };
    cubes.into_values().filter(stands).map(point).collect()
}

fn unknown(standing: &[Standing], limit: f32, embedder: Option<&Embedder>) -> Vec<SensorDetection> {
    let left: Vec<&Standing> = standing.iter().filter(|s| s.known < limit).collect();
    // By position alone the score of a point is one minus the probability of the best box around it.
    let by_place = || left.iter().map(|s| Some(1.0 - s.known)).collect();
    let scores: Vec<Option<f32>> =
        embedder.map_or_else(by_place, |e| e.unknown(standing, &left, limit));
    let pairs = left.into_iter().zip(scores).filter_map(|(point, score)| Some((point, score?)));
    let (left, scores): (Vec<&Standing>, Vec<f32>) = pairs.unzip();
    let places: Vec<[f32; 3]> = left.iter().map(|s| s.at_m).collect();
    let embeddings: Vec<&[f32]> = left.iter().map(|s| s.embedding.as_slice()).collect();
    let groups = cluster(&places, &embeddings, POINTS_MIN).into_iter();
    groups.filter_map(|group| object(&left, &scores, &group)).collect()
}

/// A tight box around a cluster; its score is the mean score of its points.
fn object(left: &[&Standing], scores: &[f32], group: &Group) -> Option<SensorDetection> {
    let origin = left[*group.first()?].at_m;
    let mut points = ClusterPoints::default();
    for &i in group {
        let [x, y, z] = left[i].at_m;
        points.push(x - origin[0], y - origin[1], z);
    }
    let sides_m = points.spans_m([1.0, 0.0]);
    let [along, aside] = sides_m.map(|[low, high]| f64::from(high - low));
    if along.hypot(aside) > LENGTH_MAX_M {
        return None;
    }
    let rectangle = minimum_area(&points);
    let ([cx, cy], [l, w]) = (rectangle.center_m(), rectangle.size_m());
    let [low, high] = points.z_range_m()?;
    // The heading is along the longer side.
    let turn_rad = if l >= w { 0.0 } else { FRAC_PI_2 };
    let (l, w, yaw) = (l.max(w), l.min(w), rectangle.yaw_rad + turn_rad);
    let unsure: f32 = group.iter().map(|i| scores[*i]).sum();
    let size = |v: f64| v.max(0.1) as f32;
    let [x, y] = [origin[0] + cx as f32, origin[1] + cy as f32];
    let size_m = [size(l), size(w), (high - low).max(0.1)];
    let place = Box3::from_f32([x, y, (low + high) / 2.0], size_m, yaw as f32);
    Some(SensorDetection::unknown(unsure / group.len() as f32, place))
}
