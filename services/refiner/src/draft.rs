//! An object in the making: one for each detection, in the detections' order.

use mluc_geometry::Box3;
use mluc_ipc_types::{Detection, FOOTPRINT_MAX, Fate, Object, ObjectKind};

/// What is known of one object before it is written out.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Draft {
    pub(crate) detection: usize,
    pub(crate) kind: ObjectKind,
    pub(crate) fate: Fate,
    /// Detection of the object that suppressed this one.
    pub(crate) by: Option<usize>,
    /// By how much, 0 to 1.
    pub(crate) overlap: f32,
    /// Bits of [`Object::flags`].
    pub(crate) flags: u32,
    pub(crate) score: f32,
    pub(crate) shape: Box3,
    /// Range in the list of points.
    pub(crate) points: (usize, usize),
    pub(crate) footprint_m: [[f32; 2]; FOOTPRINT_MAX],
    pub(crate) footprint_count: usize,
}

/// Coordinates and sizes beyond this are nonsense, m.
const FAR_M: f32 = 1e4;

/// The detection's box, if it is one.
pub(crate) fn sound_box(detection: &Detection, classes: usize) -> Option<Box3> {
    let is_near = |v: &f32| v.abs() <= FAR_M;
    let place = detection.center_m.iter().all(is_near);
    let size = detection.size_m.iter().all(is_near);
    let keeps_the_contract = detection.check(0, classes).is_ok();
    let sound = keeps_the_contract && place && size && is_near(&detection.yaw_rad);
    sound.then(|| Box3 {
        center_m: detection.center_m.map(f64::from),
        size_m: detection.size_m.map(f64::from),
        yaw_rad: f64::from(detection.yaw_rad),
    })
}

/// What orders unknown objects among each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Ranking {
    /// 1 / EDS (the paper ranks by -EDS). Boxes of background have the lowest EDS of all and come first.
    InverseEds,
    /// Objectness x (2 - e), both 0 to 1: something is there, and it lies between the prototypes.
    Objectness,
    /// Objectness x P(none of the known), of the logit at this place of the embedding.
    Unknown(usize),
}

impl Ranking {
    /// Finite; 0 where the detection's numbers make no sense.
    pub(crate) fn score(self, detection: &Detection) -> f32 {
        /// Far above anything that a model gives.
        const SCORE_MAX: f32 = 1e6;
        let score = match self {
            Ranking::InverseEds if detection.eds > 0.0 => (1.0 / detection.eds).min(SCORE_MAX),
            Ranking::InverseEds => 0.0,
            Ranking::Objectness => {
                detection.objectness * (2.0 - detection.eds_normalised).clamp(0.0, 1.0)
            }
            Ranking::Unknown(at) => {
                let logit = detection.embedding.get(at).copied().unwrap_or(f32::NAN);
                detection.objectness / (1.0 + (-logit).exp())
            }
        };
        if score.is_finite() { score } else { 0.0 }
    }
}

impl Draft {
    /// With the detection's own box.
    pub(crate) fn of_proposal(
        index: usize,
        detection: &Detection,
        shape: Box3,
        ranking: Ranking,
    ) -> Draft {
        let (kind, score) = match detection.is_candidate() {
            true => (ObjectKind::Unknown, ranking.score(detection)),
            false => (ObjectKind::Known, detection.score),
        };
        let mut draft = Draft {
            detection: index,
            kind,
            fate: Fate::Published,
            by: None,
            overlap: 0.0,
            flags: 0,
            score,
            shape,
            points: (0, 0),
            footprint_m: [[0.0; 2]; FOOTPRINT_MAX],
            footprint_count: 0,
        };
        draft.set_footprint(&shape.footprint_m(), [0.0; 2]);
        draft
    }

    /// For a detection that is none: no size, in the sensor's place.
    pub(crate) fn of_nonsense(index: usize, detection: &Detection) -> Draft {
        let nowhere = Box3::new([0.0; 7]);
        Draft {
            fate: Fate::InvalidBox,
            score: 0.0,
            footprint_count: 0,
            ..Draft::of_proposal(index, detection, nowhere, Ranking::InverseEds)
        }
    }

    /// Corners relative to an origin, m; those beyond the contract's limit are left out.
    pub(crate) fn set_footprint(&mut self, corners_m: &[[f64; 2]], origin_m: [f64; 2]) {
        self.footprint_count = corners_m.len().min(FOOTPRINT_MAX);
        self.footprint_m = [[0.0; 2]; FOOTPRINT_MAX];
        for (to, from) in self.footprint_m.iter_mut().zip(corners_m) {
            *to = [
                (from[0] + origin_m[0]) as f32,
                (from[1] + origin_m[1]) as f32,
            ];
        }
    }

    /// Covered by the object of another detection, by a share of 0 to 1.
    pub(crate) fn suppress(&mut self, fate: Fate, by: usize, overlap: f64) {
        self.fate = fate;
        self.by = Some(by);
        self.overlap = overlap.clamp(0.0, 1.0) as f32;
    }

    pub(crate) fn is_unknown(&self) -> bool {
        self.kind == ObjectKind::Unknown
    }

    /// Unknown, and nothing has suppressed it yet.
    pub(crate) fn is_standing(&self) -> bool {
        self.is_unknown() && self.fate == Fate::Published
    }

    /// The box with a margin on every side, m.
    pub(crate) fn grown(&self, margin_m: f64) -> Box3 {
        Box3 {
            size_m: self.shape.size_m.map(|s| s + 2.0 * margin_m),
            ..self.shape
        }
    }

    /// The object as the contract has it; its points begin at `points_first`.
    pub(crate) fn object(
        &self,
        detection: &Detection,
        classes: usize,
        points: (u32, u32),
    ) -> Object {
        let finite = |v: f32| if v.is_finite() { v } else { 0.0 };
        Object {
            kind: self.kind as u32,
            fate: self.fate as u32,
            by: self.by.map_or(Object::NONE, |by| by as u32),
            class_id: match (detection.class_id as usize) < classes {
                true => detection.class_id,
                false => 0,
            },
            score: self.score,
            center_m: self.shape.center_m.map(|v| v as f32),
            size_m: self.shape.size_m.map(|v| v as f32),
            yaw_rad: self.shape.yaw_rad as f32,
            eds: finite(detection.eds),
            eds_normalised: finite(detection.eds_normalised),
            threshold: finite(detection.threshold),
            points_first: points.0,
            points_count: points.1,
            flags: self.flags,
            track_id: Object::NONE,
            overlap: self.overlap,
            footprint_count: self.footprint_count as u32,
            footprint_m: self.footprint_m,
        }
    }
}
