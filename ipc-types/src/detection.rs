//! A box that the head kept (paper section 3.2).

use bytemuck::{Pod, Zeroable};
#[cfg(feature = "iceoryx2")]
use iceoryx2::prelude::ZeroCopySend;

use crate::{CLASSES_MAX, ContractError, DETECTIONS_MAX, FrameHeader};

/// Which side of the gate a detection lies on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum DetectionKind {
    /// Near a prototype.
    Known = 0,
    /// Between the prototypes: the refiner looks for an unknown object here.
    Candidate = 1,
}

/// One kept box with every score of it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[cfg_attr(
    feature = "iceoryx2",
    derive(ZeroCopySend),
    type_name("mluc.Detection")
)]
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
    /// objectness x probability of the class, 0 to 1.
    pub score: f32,
    /// softmax(-d) over the known classes (eq. 2).
    pub probabilities: [f32; CLASSES_MAX],
    /// The cell's embedding f.
    pub embedding: [f32; CLASSES_MAX],
    /// Sum of the squared distances to all prototypes (EDS, eq. 5).
    pub eds: f32,
    /// EDS / ((C-1) T^2): 1 at the centre, 2 at a prototype.
    pub eds_normalised: f32,
    /// The same without the mean of f: 1 + C |f - mean f|^2 / ((C-1) T^2).
    pub eds_perpendicular: f32,
    /// Squared distance to the nearest prototype over T^2.
    pub delta: f32,
    /// Largest probability.
    pub softmax_max: f32,
    /// Largest logit 2 T f.
    pub logit_max: f32,
    /// logsumexp(2 T f).
    pub energy: f32,
    /// The gate's threshold on `eds_normalised` that decided `kind`.
    pub threshold: f32,
}

const _: () = assert!(size_of::<Detection>() == 144);

impl Detection {
    /// Checks a whole message: version, count, class, kind, finite boxes with sizes above 0.
    pub fn checked<'a>(
        header: &FrameHeader,
        detections: &'a [Detection],
        classes: usize,
    ) -> Result<&'a [Detection], ContractError> {
        let detections = Detection::counted(header, detections)?;
        for (index, detection) in detections.iter().enumerate() {
            detection.check(index, classes)?;
        }
        Ok(detections)
    }

    /// Checks version and count of a message, for a reader that looks at each detection by itself ([`Detection::check`]).
    pub fn counted<'a>(
        header: &FrameHeader,
        detections: &'a [Detection],
    ) -> Result<&'a [Detection], ContractError> {
        header.checked()?;
        if detections.len() > DETECTIONS_MAX {
            return Err(ContractError::TooLong {
                what: "detections",
                limit: DETECTIONS_MAX,
                found: detections.len(),
            });
        }
        Ok(detections)
    }

    /// Checks class, kind and numbers of the detection in a place of its message.
    pub fn check(&self, index: usize, classes: usize) -> Result<(), ContractError> {
        if self.class_id as usize >= classes {
            return Err(ContractError::Index {
                what: "class",
                len: classes,
                found: self.class_id as usize,
            });
        }
        if self.kind > DetectionKind::Candidate as u32 {
            return Err(ContractError::Value {
                what: "kind of a detection",
                found: self.kind,
            });
        }
        let numbers = self
            .center_m
            .iter()
            .chain(&self.size_m)
            .chain([&self.yaw_rad, &self.objectness, &self.score])
            .chain([&self.eds, &self.eds_normalised, &self.threshold]);
        if !numbers.copied().all(f32::is_finite) || self.size_m.iter().any(|&s| s <= 0.0) {
            return Err(ContractError::NotFinite {
                what: "detection",
                index,
            });
        }
        Ok(())
    }

    /// Whether the gate made it a candidate unknown.
    pub fn is_candidate(&self) -> bool {
        self.kind == DetectionKind::Candidate as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(change: impl FnOnce(&mut Detection)) -> Result<(), ContractError> {
        let mut detection = Detection {
            size_m: [4.0, 2.0, 1.5],
            ..Detection::default()
        };
        change(&mut detection);
        Detection::checked(&FrameHeader::new(0, "a"), &[detection], 3).map(|_| ())
    }

    #[test]
    fn a_sound_detection_passes() {
        assert_eq!(check(|_| ()), Ok(()));
        assert_eq!(check(|d| d.kind = DetectionKind::Candidate as u32), Ok(()));
    }

    #[test]
    fn class_and_kind_are_checked() {
        assert!(matches!(
            check(|d| d.class_id = 3),
            Err(ContractError::Index {
                found: 3,
                len: 3,
                ..
            })
        ));
        assert!(matches!(
            check(|d| d.class_id = u32::MAX),
            Err(ContractError::Index { .. })
        ));
        assert!(matches!(
            check(|d| d.kind = 2),
            Err(ContractError::Value { found: 2, .. })
        ));
    }

    #[test]
    fn numbers_are_checked() {
        let refused = |change: fn(&mut Detection)| {
            matches!(check(change), Err(ContractError::NotFinite { .. }))
        };
        assert!(refused(|d| d.center_m[0] = f32::NAN));
        assert!(refused(|d| d.yaw_rad = f32::INFINITY));
        assert!(refused(|d| d.eds = f32::NAN));
        assert!(refused(|d| d.size_m[1] = 0.0));
        assert!(refused(|d| d.size_m[1] = -1.0));
    }

    #[test]
    fn too_many_or_another_version_are_errors() {
        let many = vec![
            Detection {
                size_m: [1.0; 3],
                ..Detection::default()
            };
            DETECTIONS_MAX + 1
        ];
        let mut header = FrameHeader::new(0, "a");
        assert!(Detection::checked(&header, &many[1..], 1).is_ok());
        assert!(matches!(
            Detection::checked(&header, &many, 1),
            Err(ContractError::TooLong { .. })
        ));
        header.wire_version = 0;
        assert!(matches!(
            Detection::checked(&header, &[], 1),
            Err(ContractError::WireVersion { found: 0, .. })
        ));
    }
}
