//! A box that the head kept (paper section 3.2).

use crate::error::{Result, check_index, check_length, check_numbers, check_value};
use crate::{CLASSES_MAX, DETECTIONS_MAX, FrameHeader, text::words};
use bytemuck::{Pod, Zeroable};
#[cfg(feature = "iceoryx2")]
use iceoryx2::prelude::ZeroCopySend;

/// Which side of the gate a detection lies on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum DetectionKind {
    /// Near a prototype.
    Known = 0,
    /// Between the prototypes: the refiner looks for an unknown object here.
    Candidate = 1,
}

/// The gate of the head that decided whether a box is known. The field `threshold` has its threshold, in the gate's own unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum GateKind {
    /// No gate is on: every box is known. The threshold is 0.
    None = 0,
    /// The normalised EDS (paper section 3.2): a candidate lies below the threshold.
    Eds = 1,
    /// `unknown_probability`: a candidate reaches the threshold.
    UnknownProbability = 2,
    /// The largest class probability: a candidate lies below the threshold.
    SoftmaxMax = 3,
}

words!(GateKind: "none" "eds" "unknown_probability" "softmax_max");

/// `unknown_probability` of a model without an output for the unknown.
pub const NO_PROBABILITY: f32 = -1.0;

/// Whether a number is valid in `unknown_probability`.
pub(crate) fn is_probability_or_none(value: f32) -> bool {
    value == NO_PROBABILITY || (0.0..=1.0).contains(&value)
}

/// One kept box with all its scores.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[cfg_attr(feature = "iceoryx2", derive(ZeroCopySend))]
#[cfg_attr(feature = "iceoryx2", type_name("mluc.Detection"))]
#[repr(C)]
pub struct Detection {
    /// Geometric centre, m.
    pub center_m: [f32; 3],
    /// l along heading, w, h, m.
    pub size_m: [f32; 3],
    /// Heading about +z, rad.
    pub yaw_rad: f32,
    /// Index into the model's classes: the anchor's own class.
    pub class_id: u32,
    /// [`DetectionKind`].
    pub kind: u32,
    /// Cell of the bird's-eye map.
    pub cell: u32,
    /// sigma(o) of the anchor, 0 to 1.
    pub objectness: f32,
    /// objectness x probability of the class, 0 to 1; of an anchor without a class objectness x P(unknown).
    pub score: f32,
    /// softmax(-d) over the known classes (eq. 2); zeros of an anchor without a class.
    pub probabilities: [f32; CLASSES_MAX],
    /// The cell's embedding f, one value per class, followed by zeros.
    pub embedding: [f32; CLASSES_MAX],
    /// Sum of the squared distances to all prototypes (EDS, eq. 5).
    pub eds: f32,
    /// EDS / ((C-1) T^2): 1 at the centre, 2 at a prototype.
    pub eds_normalised: f32,
    /// The normalised EDS without the mean of f: 1 + C |f - mean f|^2 / ((C-1) T^2).
    pub eds_perpendicular: f32,
    /// Squared distance to the nearest prototype over T^2.
    pub delta: f32,
    /// Largest probability.
    pub softmax_max: f32,
    /// Largest logit 2 T f.
    pub logit_max: f32,
    /// logsumexp(2 T f).
    pub energy: f32,
    /// Probability of belonging to none of the known classes, 0 to 1; [`NO_PROBABILITY`] (-1) if the model does not give it.
    pub unknown_probability: f32,
    /// [`GateKind`]: for a candidate, the gate that fired; for a known box, the gate that it passed.
    pub gate: u32,
    /// Threshold of `gate`, in its unit.
    pub threshold: f32,
}

const _: () = assert!(size_of::<Detection>() == 152);

impl Detection {
    /// Checks a whole message: version, count, class, kind, finite boxes with sizes above 0.
    pub fn checked<'a>(
        header: &FrameHeader,
        detections: &'a [Detection],
        classes: usize,
    ) -> Result<&'a [Detection]> {
        let detections = Detection::counted(header, detections)?;
        for (index, detection) in detections.iter().enumerate() {
            detection.check(index, classes)?;
        }
        Ok(detections)
    }

    /// Checks version and count of a message, for a reader that checks each detection by itself ([`Detection::check`]).
    pub fn counted<'a>(
        header: &FrameHeader,
        detections: &'a [Detection],
    ) -> Result<&'a [Detection]> {
        header.checked()?;
        check_length("detections", detections.len(), DETECTIONS_MAX)?;
        Ok(detections)
    }

    /// Checks class, kind and numbers of the detection at `index` in its message.
    pub fn check(&self, index: usize, classes: usize) -> Result<()> {
        check_index("class", self.class_id as usize, classes)?;
        check_value("kind of a detection", self.kind, 2)?;
        check_value("gate of a detection", self.gate, GateKind::NAMES.len())?;
        let is_told = is_probability_or_none(self.unknown_probability);
        let are_sides = self.size_m.iter().all(|&side| side > 0.0 && side.is_finite());
        let fields = [
            ("center_m of a detection", self.center_m.iter().all(|v| v.is_finite())),
            ("size_m of a detection", are_sides),
            ("yaw_rad of a detection", self.yaw_rad.is_finite()),
            ("objectness of a detection", self.objectness.is_finite()),
            ("score of a detection", self.score.is_finite()),
            ("eds of a detection", self.eds.is_finite()),
            ("eds_normalised of a detection", self.eds_normalised.is_finite()),
            ("threshold of a detection", self.threshold.is_finite()),
            ("unknown_probability of a detection", is_told),
        ];
        check_numbers(index, fields)
    }

    /// Whether its anchor has a class.
    pub fn has_class(&self) -> bool {
        self.probabilities.iter().any(|p| *p > 0.0)
    }

    /// Whether the gate made it a candidate unknown.
    pub fn is_candidate(&self) -> bool {
        self.kind == DetectionKind::Candidate as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A change, and how the error about it begins.
    type Change = (fn(&mut Detection), &'static str);

    /// The error about a detection with one field changed; empty: it passes.
    fn said(change: fn(&mut Detection)) -> String {
        let mut detection = Detection { size_m: [4.0, 2.0, 1.5], ..Detection::default() };
        change(&mut detection);
        Detection::checked(&FrameHeader::new(0, "a"), &[detection], 3)
            .map_or_else(|error| error.to_string(), |_| String::new())
    }

    #[test]
    fn what_breaks_the_contract_is_named() {
        assert_eq!(said(|_| ()), "");
        assert_eq!(said(|d| d.kind = DetectionKind::Candidate as u32), "");
        assert_eq!(said(|d| d.unknown_probability = NO_PROBABILITY), "");
        let changes: [Change; 11] = [
            (|d| d.class_id = 3, "class: index 3 outside of 3"),
            (|d| d.class_id = u32::MAX, "class: index 4294967295"),
            (|d| d.kind = 2, "kind of a detection: 2 is"),
            (|d| d.gate = 4, "gate of a detection: 4 is"),
            (|d| d.center_m[0] = f32::NAN, "center_m of a detection: entry 0"),
            (|d| d.yaw_rad = f32::INFINITY, "yaw_rad of a detection: entry 0"),
            (|d| d.eds = f32::NAN, "eds of a detection: entry 0"),
            (|d| d.size_m[1] = 0.0, "size_m of a detection: entry 0"),
            (|d| d.size_m[1] = -1.0, "size_m of a detection: entry 0"),
            (|d| d.unknown_probability = 1.5, "unknown_probability of a detection: entry 0"),
            (|d| d.unknown_probability = f32::NAN, "unknown_probability of a detection"),
        ];
        for (change, expected) in changes {
            let error = said(change);
            assert!(error.starts_with(expected), "{expected}: {error}");
        }
    }
}
