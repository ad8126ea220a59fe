//! What the robot gets: known and unknown objects, and those that were suppressed, with the reason.

use bytemuck::{Pod, Zeroable};
#[cfg(feature = "iceoryx2")]
use iceoryx2::prelude::ZeroCopySend;

use crate::{ContractError, FOOTPRINT_MAX, FrameHeader, OBJECT_POINTS_MAX, OBJECTS_MAX};

/// What an object is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum ObjectKind {
    /// Of a class of the model.
    Known = 0,
    /// Something that the model does not know.
    Unknown = 1,
}

/// What became of an object: published, or why not.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Fate {
    /// In the robot's list.
    Published = 0,
    /// A known object covers it; `by` says which.
    OverlapsKnown = 1,
    /// Merged into a better unknown that covers it; `by` says which.
    OverlapsUnknown = 2,
    /// Too few points to be a thing.
    TooFewPoints = 3,
    /// Larger than any road user, as it is or after it was cut to size ([`Object::SPLIT`]).
    Oversized = 4,
    /// The detection's box made no sense (a size that is not above 0, a place that is not finite).
    InvalidBox = 5,
    /// Not seen in enough of the last frames yet (temporal voting alone says so).
    Unconfirmed = 6,
    /// Smaller than any road user.
    Undersized = 7,
}

impl Fate {
    /// All, by number.
    pub const ALL: [Fate; 8] = [
        Fate::Published,
        Fate::OverlapsKnown,
        Fate::OverlapsUnknown,
        Fate::TooFewPoints,
        Fate::Oversized,
        Fate::InvalidBox,
        Fate::Unconfirmed,
        Fate::Undersized,
    ];

    /// The word in the JSON lines.
    pub fn name(self) -> &'static str {
        [
            "published",
            "overlaps_known",
            "overlaps_unknown",
            "too_few_points",
            "oversized",
            "invalid_box",
            "unconfirmed",
            "undersized",
        ][self as usize]
    }
}

/// One object.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[cfg_attr(feature = "iceoryx2", derive(ZeroCopySend), type_name("mluc.Object"))]
#[repr(C)]
pub struct Object {
    /// [`ObjectKind`].
    pub kind: u32,
    /// [`Fate`].
    pub fate: u32,
    /// Index of the object that suppressed this one; [`Object::NONE`] otherwise.
    pub by: u32,
    /// Index into the model's classes: of a known object its class, of an unknown one the class it was mistaken for.
    pub class_id: u32,
    /// Known: objectness x class probability, 0 to 1. Unknown: how surely it is an unknown object; its scale depends
    /// on the refiner and only orders unknown objects.
    pub score: f32,
    /// Geometric centre, m.
    pub center_m: [f32; 3],
    /// l, w, h, m.
    pub size_m: [f32; 3],
    /// Heading, rad; of an unknown object known up to half a turn.
    pub yaw_rad: f32,
    /// Sum of the squared distances to all prototypes.
    pub eds: f32,
    /// EDS / ((C-1) T^2).
    pub eds_normalised: f32,
    /// The gate's threshold on `eds_normalised`.
    pub threshold: f32,
    /// First entry in `object_points`.
    pub points_first: u32,
    /// Entries there.
    pub points_count: u32,
    /// What is out of the ordinary: bits, [`Object::UNREFINED`], [`Object::SPLIT`], [`Object::THINNED`].
    pub flags: u32,
    /// The same over the frames in which it was seen (temporal voting); [`Object::NONE`] without.
    pub track_id: u32,
    /// By how much `by` covers this one, 0 to 1; 0 without. A known object: share of this one's points in its box, or
    /// bird's-eye intersection over union where that decided. An unknown one: intersection over the smaller area.
    pub overlap: f32,
    /// Corners of the footprint in use.
    pub footprint_count: u32,
    /// Convex outline seen from above, counter-clockwise, x and y in m.
    pub footprint_m: [[f32; 2]; FOOTPRINT_MAX],
}

const _: () = assert!(size_of::<Object>() == 21 * 4 + FOOTPRINT_MAX * 8);

impl Object {
    /// No object, no track.
    pub const NONE: u32 = u32::MAX;
    /// Bit of `flags`: the frame's budget ended before its turn, so its box is the proposal's.
    pub const UNREFINED: u32 = 1;
    /// Bit of `flags`: a piece of a cluster larger than any road user, cut to size.
    pub const SPLIT: u32 = 1 << 1;
    /// Bit of `flags`: more points than one candidate may look at; box and points come from an even share of them.
    pub const THINNED: u32 = 1 << 2;
    /// The bits of `flags` and their names in the JSON lines, in order.
    pub const FLAG_NAMES: [&'static str; 3] = ["unrefined", "split", "thinned"];

    /// Checks a whole message: version, count, enums, indices, finite numbers.
    pub fn checked<'a>(
        header: &FrameHeader,
        objects: &'a [Object],
        classes: usize,
    ) -> Result<&'a [Object], ContractError> {
        header.checked()?;
        if objects.len() > OBJECTS_MAX {
            return Err(ContractError::TooLong {
                what: "objects",
                limit: OBJECTS_MAX,
                found: objects.len(),
            });
        }
        for (index, o) in objects.iter().enumerate() {
            o.check(index, objects.len(), classes)?;
        }
        Ok(objects)
    }

    fn check(&self, index: usize, objects: usize, classes: usize) -> Result<(), ContractError> {
        let bound = |what, found: u32, len: usize| match (found as usize) < len {
            true => Ok(()),
            false => Err(ContractError::Index {
                what,
                len,
                found: found as usize,
            }),
        };
        if self.kind > ObjectKind::Unknown as u32 {
            return Err(ContractError::Value {
                what: "kind of an object",
                found: self.kind,
            });
        }
        if self.fate as usize >= Fate::ALL.len() {
            return Err(ContractError::Value {
                what: "fate of an object",
                found: self.fate,
            });
        }
        if self.by != Object::NONE {
            bound("suppressing object", self.by, objects)?;
        }
        bound("class", self.class_id, classes)?;
        bound("footprint corners", self.footprint_count, FOOTPRINT_MAX + 1)?;
        let points_end = u64::from(self.points_first) + u64::from(self.points_count);
        if points_end > OBJECT_POINTS_MAX as u64 {
            return Err(ContractError::Index {
                what: "object points",
                len: OBJECT_POINTS_MAX,
                found: points_end as usize,
            });
        }
        let corners = &self.footprint_m[..self.footprint_count as usize];
        let numbers = self
            .center_m
            .iter()
            .chain(&self.size_m)
            .chain([&self.yaw_rad, &self.score, &self.eds])
            .chain([&self.eds_normalised, &self.threshold, &self.overlap])
            .chain(corners.iter().flatten());
        match numbers.copied().all(f32::is_finite) {
            true => Ok(()),
            false => Err(ContractError::NotFinite {
                what: "object",
                index,
            }),
        }
    }

    /// Checks an `object_points` message: version, count, and every index against the `points` of the scan.
    pub fn checked_points<'a>(
        header: &FrameHeader,
        indices: &'a [u32],
        points: usize,
    ) -> Result<&'a [u32], ContractError> {
        header.checked()?;
        if indices.len() > OBJECT_POINTS_MAX {
            return Err(ContractError::TooLong {
                what: "object points",
                limit: OBJECT_POINTS_MAX,
                found: indices.len(),
            });
        }
        match indices.iter().find(|&&index| index as usize >= points) {
            None => Ok(indices),
            Some(&index) => Err(ContractError::Index {
                what: "point of an object",
                len: points,
                found: index as usize,
            }),
        }
    }

    /// Published, and not suppressed.
    pub fn is_published(&self) -> bool {
        self.fate == Fate::Published as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn object() -> Object {
        Object {
            by: Object::NONE,
            size_m: [1.0; 3],
            footprint_count: 4,
            ..Object::zeroed()
        }
    }

    fn check(change: impl FnOnce(&mut Object)) -> Result<(), ContractError> {
        let mut object = object();
        change(&mut object);
        Object::checked(&FrameHeader::new(0, "a"), &[object], 3).map(|_| ())
    }

    #[test]
    fn a_sound_object_passes() {
        assert_eq!(check(|_| ()), Ok(()));
        assert_eq!(check(|o| o.by = 0), Ok(()));
        assert_eq!(check(|o| o.footprint_count = FOOTPRINT_MAX as u32), Ok(()));
    }

    #[test]
    fn an_enum_value_out_of_range_is_an_error() {
        assert!(matches!(
            check(|o| o.kind = 2),
            Err(ContractError::Value { found: 2, .. })
        ));
        let beyond = Fate::ALL.len() as u32;
        assert!(matches!(
            check(|o| o.fate = beyond),
            Err(ContractError::Value { found, .. }) if found == beyond
        ));
    }

    #[test]
    fn an_index_out_of_range_is_an_error() {
        let refused =
            |change: fn(&mut Object)| matches!(check(change), Err(ContractError::Index { .. }));
        assert!(refused(|o| o.class_id = 3));
        assert!(refused(|o| o.by = 1));
        assert!(refused(|o| o.footprint_count = FOOTPRINT_MAX as u32 + 1));
        assert!(refused(|o| o.points_first = OBJECT_POINTS_MAX as u32 + 1));
        assert!(refused(
            |o| (o.points_first, o.points_count) = (u32::MAX, u32::MAX)
        ));
    }

    #[test]
    fn a_number_that_is_not_finite_is_an_error() {
        let refused =
            |change: fn(&mut Object)| matches!(check(change), Err(ContractError::NotFinite { .. }));
        assert!(refused(|o| o.center_m[1] = f32::NAN));
        assert!(refused(|o| o.size_m[2] = f32::INFINITY));
        assert!(refused(|o| o.eds = f32::NAN));
        assert!(refused(|o| o.footprint_m[3][1] = f32::NEG_INFINITY));
        assert_eq!(
            check(|o| o.footprint_m[4][0] = f32::NAN),
            Ok(()),
            "a corner that is not in use"
        );
    }

    #[test]
    fn too_many_objects_or_another_version_are_errors() {
        let many = vec![object(); OBJECTS_MAX + 1];
        let mut header = FrameHeader::new(0, "a");
        assert!(matches!(
            Object::checked(&header, &many, 3),
            Err(ContractError::TooLong { .. })
        ));
        header.wire_version += 1;
        assert!(matches!(
            Object::checked(&header, &[], 3),
            Err(ContractError::WireVersion { .. })
        ));
    }

    #[test]
    fn point_indices_are_checked_against_the_scan() {
        let header = FrameHeader::new(0, "a");
        assert_eq!(
            Object::checked_points(&header, &[0, 9], 10),
            Ok(&[0, 9][..])
        );
        assert!(matches!(
            Object::checked_points(&header, &[0, 10], 10),
            Err(ContractError::Index { found: 10, .. })
        ));
        let many = vec![0; OBJECT_POINTS_MAX + 1];
        assert!(matches!(
            Object::checked_points(&header, &many, 10),
            Err(ContractError::TooLong { .. })
        ));
    }
}
