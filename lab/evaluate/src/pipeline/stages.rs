//! The stages one after the other, as plain function calls.

use super::{DetectedFrame, FrameSet, ModelGate};
use crate::{EvaluateError, ObjectKind, SensorDetection, UNKNOWN};
use mluc_backbone::{Backbone, Precision};
use mluc_geometry::Box3;
use mluc_head::{Detection, Head};
use mluc_ipc_types::{Disposition, Object, Point};
use mluc_model::{HeadKind, Model};
use mluc_refiner::{Refiner, RefinerError, RefinerOutput, Settings};

/// Backbone and head: points to kept boxes, each with every score.
#[derive(Debug)]
pub struct Detector {
    backbone: Backbone,
    head: Head,
    cells: Vec<u32>,
    rows: Vec<f32>,
    generic: usize,
}

impl Detector {
    /// For one model.
    pub fn new(model: &Model) -> Result<Detector, EvaluateError> {
        Detector::with_precision(model, Precision::default())
    }

    /// For one model, with the backbone in this precision.
    pub fn with_precision(model: &Model, precision: Precision) -> Result<Detector, EvaluateError> {
        let mut manifest = model.manifest.clone();
        if manifest.network.head == HeadKind::Open {
            // Boxes without a class are kept whatever the threshold: [`ModelGate`] drops them later.
            manifest.thresholds.unknown_min = f32::MIN_POSITIVE;
        }
        Ok(Detector {
            backbone: Backbone::with_precision(&manifest, &model.weights, precision)?,
            head: Head::new(&manifest, &model.weights)?,
            cells: Vec::new(),
            rows: Vec::new(),
            generic: 0,
        })
    }

    /// Kept boxes of one scan, the best objectness first, then those without a class. Their kind says nothing: [`ModelGate`] does.
    pub fn detect(&mut self, points: &[Point]) -> Result<Vec<Detection>, EvaluateError> {
        let frame = self.backbone.run(bytemuck::cast_slice(points));
        self.cells.resize(frame.rows, 0);
        let values = frame.rows * self.backbone.feature_channels();
        self.rows.resize(values, 0.0);
        self.backbone.write_rows(&mut self.cells, &mut self.rows)?;
        let mut detections = Vec::new();
        let counts = self.head.run(&self.cells, &self.rows, &mut detections)?;
        self.generic = counts.generic as usize;
        Ok(detections)
    }

    /// How many boxes of the last scan are of anchors without a class: the last ones of its list.
    pub fn generic(&self) -> usize {
        self.generic
    }
}

/// A published object, as small as it can be kept for many thresholds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FoundObject {
    /// Known or unknown.
    pub kind: ObjectKind,
    /// Index into the model's classes; of an unknown one the class it was mistaken for.
    pub class_id: u32,
    /// Known: objectness x class probability. Unknown: orders the unknown ones alone.
    pub score: f32,
    /// x, y, z, l, w, h (m), yaw (rad), sensor frame.
    pub bounds: [f32; 7],
}

impl FoundObject {
    fn of(object: &Object) -> FoundObject {
        let ([x, y, z], [l, w, h]) = (object.center_m, object.size_m);
        FoundObject {
            kind: if object.kind == ObjectKind::Unknown as u32 {
                ObjectKind::Unknown
            } else {
                ObjectKind::Known
            },
            class_id: object.class_id,
            score: object.score,
            bounds: [x, y, z, l, w, h, object.yaw_rad],
        }
    }

    /// A detection's own box, of this kind and score.
    pub fn of_box(detection: &Detection, kind: ObjectKind, score: f32) -> FoundObject {
        let ([x, y, z], [l, w, h]) = (detection.center_m, detection.size_m);
        FoundObject {
            kind,
            class_id: detection.class_id,
            score,
            bounds: [x, y, z, l, w, h, detection.yaw_rad],
        }
    }

    /// Its box.
    pub fn box_in_sensor(&self) -> Box3 {
        Box3::new(self.bounds.map(f64::from))
    }

    /// As the evaluator takes it; `classes` are the model's, in order.
    pub fn to_detection(&self, classes: &[String]) -> SensorDetection {
        let named = || classes.get(self.class_id as usize).cloned();
        let class = match self.kind {
            ObjectKind::Unknown => UNKNOWN.to_owned(),
            ObjectKind::Known => named().unwrap_or_default(),
        };
        SensorDetection {
            kind: self.kind,
            class,
            score: f64::from(self.score),
            box_in_sensor: self.box_in_sensor(),
        }
    }
}

/// The gate at any threshold, and the refiner.
#[derive(Debug)]
pub struct ObjectFinder {
    gate: ModelGate,
    refiner: Refiner,
    refined: RefinerOutput,
    gated: Vec<Detection>,
}

impl ObjectFinder {
    /// For one model.
    pub fn new(model: &Model, settings: &Settings) -> Result<ObjectFinder, RefinerError> {
        Ok(ObjectFinder {
            gate: ModelGate::of(model),
            refiner: Refiner::for_model(settings.clone(), model)?,
            refined: RefinerOutput::default(),
            gated: Vec::new(),
        })
    }

    /// What is published when the gate has this threshold; 0 is the closed set. In the order of the detections, the last
    /// `generic` of which have no class.
    pub fn objects(
        &mut self,
        sequence: u64,
        points: &[Point],
        (detections, generic): (&[Detection], usize),
        threshold: f32,
    ) -> Vec<FoundObject> {
        let (gate, first) = (self.gate, detections.len().saturating_sub(generic));
        let boxes = detections.iter().enumerate();
        let gated = boxes.filter_map(|(i, d)| gate.apply(d, i >= first, threshold));
        self.objects_of(sequence, points, gated)
    }

    /// What is published of detections whose kind is settled, in their order.
    pub fn objects_of(
        &mut self,
        sequence: u64,
        points: &[Point],
        detections: impl Iterator<Item = Detection>,
    ) -> Vec<FoundObject> {
        self.gated.clear();
        self.gated.extend(detections);
        self.refiner
            .refine(sequence, points, &self.gated, &mut self.refined);
        let published = |object: &&Object| object.disposition == Disposition::Published as u32;
        let objects = self.refined.objects.iter().filter(published);
        objects.map(FoundObject::of).collect()
    }
}

/// A scan in, objects out.
#[derive(Debug)]
pub struct Pipeline {
    detector: Detector,
    finder: ObjectFinder,
    classes: Vec<String>,
}

impl Pipeline {
    /// For one model.
    pub fn new(model: &Model, settings: &Settings) -> Result<Pipeline, EvaluateError> {
        Ok(Pipeline {
            detector: Detector::new(model)?,
            finder: ObjectFinder::new(model, settings)?,
            classes: class_names(model),
        })
    }

    /// [`Detector::detect`].
    pub fn detect(&mut self, points: &[Point]) -> Result<Vec<Detection>, EvaluateError> {
        self.detector.detect(points)
    }

    /// [`ObjectFinder::objects`] of what [`Pipeline::detect`] gave last, as the evaluator takes them.
    pub fn objects(
        &mut self,
        sequence: u64,
        points: &[Point],
        detections: &[Detection],
        threshold: f32,
    ) -> Vec<SensorDetection> {
        let boxes = (detections, self.detector.generic());
        let found = self.finder.objects(sequence, points, boxes, threshold);
        let classes = &self.classes;
        found.iter().map(|o| o.to_detection(classes)).collect()
    }
}

/// The model's classes, in order.
pub fn class_names(model: &Model) -> Vec<String> {
    let classes = model.manifest.classes.iter();
    classes.map(|class| class.name.clone()).collect()
}

/// The network over every frame of a set, one after the other (a frame uses all threads of the pool). `step` is called
/// after each.
pub fn detect_frames(
    model: &Model,
    set: &FrameSet,
    step: impl FnMut(),
) -> Result<Vec<DetectedFrame>, EvaluateError> {
    detect_frames_in(Precision::default(), model, set, step)
}

/// [`detect_frames`] with the backbone in this precision.
pub fn detect_frames_in(
    precision: Precision,
    model: &Model,
    set: &FrameSet,
    mut step: impl FnMut(),
) -> Result<Vec<DetectedFrame>, EvaluateError> {
    let mut detector = Detector::with_precision(model, precision)?;
    let mut detected = Vec::with_capacity(set.len());
    for index in 0..set.len() {
        let detections = detector.detect(&set.points(index)?)?;
        detected.push(DetectedFrame {
            truth: set.truth(index)?,
            detections,
            generic: detector.generic(),
        });
        step();
    }
    Ok(detected)
}
