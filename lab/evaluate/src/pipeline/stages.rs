//! The stages in sequence, as plain function calls: the network on scans, then a gate and the refiner at many thresholds.

use super::{DetectedFrame, FrameSet, ModelGate};
use crate::{ClassRule, JudgedPoint, LabelledFrame, ObjectKind, Result, SensorDetection, UNKNOWN};
use mluc_backbone::{Backbone, Precision};
use mluc_geometry::Box3;
use mluc_head::{Detection, Head, stand_on_ground};
use mluc_ipc_types::Object;
use mluc_model::{HeadKind, Model};
use mluc_refiner::{Refiner, RefinerError, RefinerOutput, Settings};
use rayon::prelude::*;

/// Runs the network on every frame of a set, one after the other (a frame uses all threads of the pool), with this precision of the backbone.
/// `step` is called after each frame. The kinds of the detections are not meaningful: [`ModelGate`] sets them.
pub fn detect_frames(
    precision: Precision,
    model: &Model,
    set: &FrameSet,
    mut step: impl FnMut(),
) -> Result<Vec<DetectedFrame>> {
    let mut manifest = model.manifest.clone();
    if manifest.network.head == HeadKind::Open {
        // Boxes without a class are kept at any threshold: the gate drops them later.
        manifest.thresholds.unknown_min = f32::MIN_POSITIVE;
    }
    let mut backbone = Backbone::with_precision(&manifest, &model.weights, precision)?;
    let mut head = Head::new(&manifest, &model.weights)?;
    let mut one = |index: usize| {
        let points = set.points(index)?;
        backbone.run(bytemuck::cast_slice(&points));
        let (cells, rows) = backbone.last_rows()?;
        let mut detections = Vec::new();
        head.run(&cells, &rows, &mut detections)?;
        stand_on_ground(&mut detections, backbone.ground_m());
        step();
        let truth = set.truth(index)?;
        Ok(DetectedFrame { truth, detections })
    };
    (0..set.names().len()).map(&mut one).collect()
}

impl SensorDetection {
    /// An object of one of the model's `classes`.
    pub fn known(class_id: u32, classes: &[String], score: f32, place: Box3) -> SensorDetection {
        SensorDetection {
            kind: ObjectKind::Known,
            class: classes.get(class_id as usize).cloned().unwrap_or_default(),
            score: f64::from(score),
            probability: None,
            track: None,
            box_in_sensor: place,
        }
    }

    /// An unknown object; its score ranks it among the unknown ones only.
    pub fn unknown(score: f32, place: Box3) -> SensorDetection {
        SensorDetection {
            kind: ObjectKind::Unknown,
            class: UNKNOWN.to_owned(),
            ..SensorDetection::known(0, &[], score, place)
        }
    }

    /// A network's box as an object of its class.
    pub fn of_box(detection: &Detection, classes: &[String]) -> SensorDetection {
        let (class_id, score) = (detection.class_id, detection.score);
        SensorDetection::known(class_id, classes, score, box_of(detection))
    }

    /// The published objects of the refiner, in its order.
    pub fn published(refined: &RefinerOutput, classes: &[String]) -> Vec<SensorDetection> {
        let object = |o: &Object| {
            let place = Box3::from_f32(o.center_m, o.size_m, o.yaw_rad);
            if o.kind == ObjectKind::Unknown as u32 {
                SensorDetection::unknown(o.score, place)
            } else {
                SensorDetection::known(o.class_id, classes, o.score, place)
            }
        };
        refined.objects.iter().filter(|o| o.is_published()).map(object).collect()
    }
}

/// A detection's box.
pub fn box_of(detection: &Detection) -> Box3 {
    Box3::from_f32(detection.center_m, detection.size_m, detection.yaw_rad)
}

/// Objects at every threshold of a gate.
#[derive(Clone, Debug)]
pub struct GatedObjects {
    /// Thresholds, ascending; the first is 0, the closed set.
    pub thresholds: Vec<f64>,
    /// Objects by frame, then by threshold index.
    pub objects: Vec<Vec<Vec<SensorDetection>>>,
}

impl GatedObjects {
    /// The frames in which the objects were found, with the objects of the threshold with index `at`.
    pub fn labelled(&self, frames: &[DetectedFrame], at: usize) -> Vec<LabelledFrame> {
        let frames = frames.iter().enumerate();
        let with = |(i, f): (usize, &DetectedFrame)| f.truth.with(&self.objects[i][at]);
        frames.map(with).collect()
    }

    /// Evaluates every threshold on the frames in which the objects were found. The result does not depend on the number of threads.
    pub fn sweep(&self, frames: &[DetectedFrame], rules: &[ClassRule]) -> Vec<JudgedPoint> {
        let point = |(at, threshold): (usize, &f64)| {
            JudgedPoint::of(*threshold, &self.labelled(frames, at), rules)
        };
        self.thresholds.par_iter().enumerate().map(point).collect()
    }

    /// Every box unchanged, as an object of its class, at the single threshold 0.
    pub fn ungated(model: &Model, frames: &[DetectedFrame]) -> GatedObjects {
        let classes = model.manifest.class_names();
        let known = |d: &Detection| SensorDetection::of_box(d, &classes);
        let of_frame = |frame: &DetectedFrame| vec![frame.detections.iter().map(known).collect()];
        GatedObjects { thresholds: vec![0.0], objects: frames.iter().map(of_frame).collect() }
    }
}

/// The refiner's published objects at each threshold of a gate; thresholds ascend and are f32 values. Frames are processed in parallel (`step`
/// is called after each); the result does not depend on the number of threads.
pub fn objects_at(
    model: &Model,
    gate: ModelGate,
    set: &FrameSet,
    frames: &[DetectedFrame],
    settings: &Settings,
    thresholds: Vec<f64>,
    step: &(dyn Fn() + Sync),
) -> Result<GatedObjects> {
    let classes = model.manifest.class_names();
    // A refiner's buffers are large, so they are reused from frame to frame.
    let refiner = || Refiner::for_model(settings.clone(), model);
    let one = |refiner: &mut Result<Refiner, RefinerError>, index: usize| {
        let refiner = refiner.as_mut().map_err(|e| e.clone())?;
        let (points, mut refined) = (set.points(index)?, RefinerOutput::default());
        let mut found: Vec<Vec<SensorDetection>> = Vec::with_capacity(thresholds.len());
        let mut before = None;
        for &threshold in &thresholds {
            let gated = frames[index].gated(gate, threshold as f32);
            let candidates = gated.iter().filter(|d| d.is_candidate()).count();
            // Thresholds ascend: an equal number of candidates means the same candidates.
            let objects = match found.last() {
                Some(last) if before == Some(candidates) => last.clone(),
                _ => {
                    refiner.refine(index as u64, &points, &gated, &mut refined);
                    SensorDetection::published(&refined, &classes)
                }
            };
            before = Some(candidates);
            found.push(objects);
        }
        step();
        Ok(found)
    };
    let frames = (0..set.names().len()).into_par_iter();
    let objects: Result<_> = frames.map_init(refiner, one).collect();
    Ok(GatedObjects { objects: objects?, thresholds })
}
