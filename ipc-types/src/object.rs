//! What the robot gets: known and unknown objects, and those that were suppressed, with the reason.

use bytemuck::{Pod, Zeroable};

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
    /// A better unknown covers it; `by` says which.
    OverlapsUnknown = 2,
    /// Too few points to be a thing.
    TooFewPoints = 3,
    /// Larger than any road user.
    Oversized = 4,
}

impl Fate {
    /// All, by number.
    pub const ALL: [Fate; 5] = [
        Fate::Published,
        Fate::OverlapsKnown,
        Fate::OverlapsUnknown,
        Fate::TooFewPoints,
        Fate::Oversized,
    ];

    /// The word in the JSON lines.
    pub fn name(self) -> &'static str {
        [
            "published",
            "overlaps_known",
            "overlaps_unknown",
            "too_few_points",
            "oversized",
        ][self as usize]
    }
}

/// One object.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
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
    /// Corners of the footprint in use.
    pub footprint_count: u32,
    /// Convex outline seen from above, counter-clockwise, x and y in m.
    pub footprint_m: [[f32; 2]; FOOTPRINT_MAX],
}

const _: () = assert!(size_of::<Object>() == 18 * 4 + FOOTPRINT_MAX * 8);

impl Object {
    /// No object.
    pub const NONE: u32 = u32::MAX;

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
        let numbers = self
            .center_m
            .iter()
            .chain(&self.size_m)
            .chain([&self.yaw_rad, &self.score]);
        match numbers.copied().all(f32::is_finite) {
            true => Ok(()),
            false => Err(ContractError::NotFinite {
                what: "object",
                index,
            }),
        }
    }

    /// Published, and not suppressed.
    pub fn is_published(&self) -> bool {
        self.fate == Fate::Published as u32
    }
}
