//! The head's proposals and what becomes of them: one for each detection, in the detections' order, then the second readings.

use crate::{clusters::Measures, fit::Footprint};
use mluc_geometry::Box3;
use mluc_ipc_types::{Detection, Disposition, GateKind, NO_PROBABILITY, Object, ObjectKind};

/// The state of one object before it is written out.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Proposal {
    pub(crate) detection: usize,
    pub(crate) kind: ObjectKind,
    pub(crate) disposition: Disposition,
    /// Detection of the object that suppressed this one.
    pub(crate) suppressed_by: Option<usize>,
    /// The share of this object that the other one covers, 0 to 1.
    pub(crate) overlap: f32,
    /// Bits of [`Object::flags`].
    pub(crate) flags: u32,
    pub(crate) score: f32,
    pub(crate) shape: Box3,
    /// Range in the list of points.
    pub(crate) points: (usize, usize),
    pub(crate) footprint: Footprint,
    /// Measurements of its cluster, if the variant takes any.
    pub(crate) measures: Option<Measures>,
    /// Whether it is the second reading of a candidate: the candidate as a known object.
    pub(crate) is_second: bool,
    /// Whether it is known and P(unknown) says that it may not be.
    pub(crate) is_doubted: bool,
    /// The best unknown object that lies where this doubted one lies, or its first reading, and the share of overlap.
    pub(crate) rival: Option<(usize, f32)>,
    /// Whether a known object is below the score of the profile.
    pub(crate) is_low: bool,
}

/// Clusters and points this near to a proposal's centre come first, m.
pub(crate) const NEAR_M: f64 = 1.5;
/// A box without a point is enlarged by this factor.
pub(crate) const ENLARGED: f64 = 1.2;

/// Radius around a proposal's centre in which its cluster is searched, m: to its enlarged corners, but at least 4 m, because a proposal may be a
/// metre off and often only the far end of a long object is seen; at most 10 m, because boxes may be larger than any object.
pub(crate) fn reach_m(shape: &Box3) -> f64 {
    (shape.half_diagonal_m() * ENLARGED).clamp(4.0, 10.0)
}

/// Only known objects with at least this score suppress.
const KNOWN_SCORE_MIN: f32 = 0.5;
/// Coordinates and sizes beyond this are invalid, m.
const FAR_M: f32 = 1e4;

/// The detection's box; `None` if it is invalid.
pub(crate) fn valid_box(detection: &Detection, classes: usize) -> Option<Box3> {
    let is_near = |v: &f32| v.abs() <= FAR_M;
    let is_sound = detection.check(0, classes).is_ok()
        && detection.center_m.iter().all(is_near)
        && detection.size_m.iter().all(is_near)
        && is_near(&detection.yaw_rad);
    is_sound.then(|| Box3::from_f32(detection.center_m, detection.size_m, detection.yaw_rad))
}

impl Proposal {
    /// The proposal of a detection, with the detection's own box.
    pub(crate) fn of_detection(
        index: usize,
        detection: &Detection,
        shape: Box3,
        unknown_score: f32,
    ) -> Proposal {
        let (kind, score) = if detection.is_candidate() {
            (ObjectKind::Unknown, unknown_score)
        } else {
            (ObjectKind::Known, detection.score)
        };
        Proposal {
            detection: index,
            kind,
            disposition: Disposition::Published,
            suppressed_by: None,
            overlap: 0.0,
            flags: 0,
            score,
            shape,
            points: (0, 0),
            footprint: Footprint::of_box(&shape),
            measures: None,
            is_second: false,
            is_doubted: false,
            rival: None,
            is_low: false,
        }
    }

    /// The second reading of a candidate: the box of its class.
    pub(crate) fn second(&self, detection: &Detection) -> Proposal {
        Proposal {
            kind: ObjectKind::Known,
            score: detection.score,
            is_second: true,
            rival: Some((self.detection, 1.0)),
            ..*self
        }
    }

    /// The proposal of an invalid detection: without size, at the sensor.
    pub(crate) fn invalid(index: usize, detection: &Detection) -> Proposal {
        let nowhere = Box3::new([0.0; 7]);
        Proposal {
            disposition: Disposition::InvalidBox,
            footprint: Footprint::default(),
            ..Proposal::of_detection(index, detection, nowhere, 0.0)
        }
    }

    /// Marks it as covered by the object of another detection, by a share of 0 to 1.
    pub(crate) fn suppress(&mut self, disposition: Disposition, by: usize, overlap: f64) {
        self.disposition = disposition;
        self.suppressed_by = Some(by);
        self.overlap = overlap.clamp(0.0, 1.0) as f32;
    }

    /// Whether it is known, with a valid box.
    pub(crate) fn is_known(&self) -> bool {
        self.kind == ObjectKind::Known && self.disposition == Disposition::Published
    }

    /// Whether it is known for sure, and to be published: points in its box belong to it.
    pub(crate) fn is_sure(&self) -> bool {
        let is_unsure = self.is_second || self.is_doubted || self.is_low;
        self.is_known() && !is_unsure && self.score >= KNOWN_SCORE_MIN
    }

    /// Whether it is unknown and not suppressed.
    pub(crate) fn is_standing(&self) -> bool {
        self.kind == ObjectKind::Unknown && self.disposition == Disposition::Published
    }

    /// The object in the contract's form, without points.
    pub(crate) fn object(&self, detection: &Detection, classes: usize) -> Object {
        let finite = |v: f32| if v.is_finite() { v } else { 0.0 };
        let probability = Some(detection.unknown_probability).filter(|p| (0.0..=1.0).contains(p));
        let class = Some(detection.class_id).filter(|class| (*class as usize) < classes);
        let is_gate = (detection.gate as usize) < GateKind::NAMES.len();
        Object {
            kind: self.kind as u32,
            disposition: self.disposition as u32,
            suppressed_by: self.suppressed_by.map_or(Object::NONE, |by| by as u32),
            class_id: class.unwrap_or(0),
            score: finite(self.score),
            center_m: self.shape.center_m.map(|v| v as f32),
            size_m: self.shape.size_m.map(|v| v as f32),
            yaw_rad: self.shape.yaw_rad as f32,
            eds: finite(detection.eds),
            eds_normalised: finite(detection.eds_normalised),
            unknown_probability: probability.unwrap_or(NO_PROBABILITY),
            gate: if is_gate { detection.gate } else { 0 },
            threshold: finite(detection.threshold),
            points_first: 0,
            points_count: 0,
            flags: self.flags,
            track_id: Object::NONE,
            overlap: self.overlap,
            footprint_count: self.footprint.count as u32,
            footprint_m: self.footprint.corners_m,
        }
    }
}
