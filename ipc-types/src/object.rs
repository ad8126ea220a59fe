//! What the robot gets: known and unknown objects, and those that were suppressed, with the reason.

use crate::error::{Result, check_index, check_length, check_numbers, check_value, require};
use crate::{
    ContractError, FOOTPRINT_MAX, FrameHeader, GateKind, OBJECT_POINTS_MAX, OBJECTS_MAX, Stage,
};
use crate::{detection::is_probability_or_none, text::words};
use bytemuck::{Pod, Zeroable};
#[cfg(feature = "iceoryx2")]
use iceoryx2::prelude::ZeroCopySend;

/// What an object is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum ObjectKind {
    /// An object of one of the model's classes.
    Known = 0,
    /// Something that the model does not know.
    Unknown = 1,
}

/// What became of an object: published, or why not.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Disposition {
    /// In the robot's list.
    Published = 0,
    /// A known object covers it; `suppressed_by` says which.
    OverlapsKnown = 1,
    /// Merged into a better unknown object that covers it, or a known object that may be unknown, where an unknown one counts; `suppressed_by` says which.
    OverlapsUnknown = 2,
    /// Too few points to be a thing.
    TooFewPoints = 3,
    /// Larger than any road user, as it is or after it was cut to size ([`Object::SPLIT`]).
    Oversized = 4,
    /// The detection's box made no sense (a size that is not above 0, a place that is not finite).
    InvalidBox = 5,
    /// Its track is too unlikely, or was seen in too few of the last frames.
    Unconfirmed = 6,
    /// Lower or narrower than what `[robot]` in the configuration counts as an obstacle.
    Undersized = 7,
    /// Its score is below what the operating profile publishes.
    LowScore = 8,
}

words!(Disposition: "published" "overlaps_known" "overlaps_unknown" "too_few_points" "oversized" "invalid_box"
    "unconfirmed" "undersized" "low_score");

/// Data of an object's track.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TrackNews {
    /// Scans since it was first seen; 254 means 254 or more.
    pub age_scans: u32,
    /// Speed over the ground, to 0.25 m/s; 63.5 means 63.5 m/s or more. `None`: the sensor's own motion is not known.
    pub speed_mps: Option<f32>,
    /// Whether it is worth an alarm.
    pub is_confirmed: bool,
}

/// One object.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[cfg_attr(feature = "iceoryx2", derive(ZeroCopySend), type_name("mluc.Object"))]
#[repr(C)]
pub struct Object {
    /// [`ObjectKind`].
    pub kind: u32,
    /// [`Disposition`].
    pub disposition: u32,
    /// Index of the object that suppressed this one; [`Object::NONE`] otherwise.
    pub suppressed_by: u32,
    /// Index into the model's classes: for a known object its class, for an unknown one the class that it was mistaken for.
    pub class_id: u32,
    /// Known: objectness x class probability, 0 to 1. Unknown: confidence that it is an unknown object; its scale depends
    /// on the refiner, so it only orders unknown objects.
    pub score: f32,
    /// Geometric centre, m.
    pub center_m: [f32; 3],
    /// l, w, h, m.
    pub size_m: [f32; 3],
    /// Heading, rad; for an unknown object it is ambiguous by half a turn.
    pub yaw_rad: f32,
    /// Sum of the squared distances to all prototypes.
    pub eds: f32,
    /// EDS / ((C-1) T^2).
    pub eds_normalised: f32,
    /// From its detection: probability of belonging to none of the known classes, 0 to 1; [`crate::NO_PROBABILITY`] (-1) if the model gives none.
    pub unknown_probability: f32,
    /// [`GateKind`] of its detection.
    pub gate: u32,
    /// Threshold of `gate`, in its unit.
    pub threshold: f32,
    /// First entry in `object_points`.
    pub points_first: u32,
    /// Number of its entries in `object_points`.
    pub points_count: u32,
    /// What is out of the ordinary. Bits: [`Object::UNREFINED`], [`Object::SPLIT`], [`Object::THINNED`], [`Object::SMALL`], [`Object::LARGE`],
    /// [`Object::POST`], [`Object::CONFIRMED`]. The upper bytes are numbers: [`Object::track`] and [`Object::probability`].
    pub flags: u32,
    /// The number of its track, the same in all frames in which it was seen (temporal voting); [`Object::NONE`] without a track.
    pub track_id: u32,
    /// How much `suppressed_by` covers this object, 0 to 1; 0 without one. If that is a known object: share of this object's points in its
    /// box, or bird's-eye intersection over union if that decided. If that is an unknown object: intersection over the smaller area.
    pub overlap: f32,
    /// Corners of the footprint in use.
    pub footprint_count: u32,
    /// Convex outline seen from above, counter-clockwise, x and y in m.
    pub footprint_m: [[f32; 2]; FOOTPRINT_MAX],
}

const _: () = assert!(size_of::<Object>() == 23 * 4 + FOOTPRINT_MAX * 8);

impl Object {
    /// No object, no track.
    pub const NONE: u32 = u32::MAX;
    /// Bit of `flags`: the frame's limit of time or work was reached before its turn, or its points are gone. Its box is the proposal's.
    pub const UNREFINED: u32 = 1;
    /// Bit of `flags`: a piece of a cluster larger than any road user, cut to size.
    pub const SPLIT: u32 = 1 << 1;
    /// Bit of `flags`: it has more points than one candidate may use; box and points come from an even share of them.
    pub const THINNED: u32 = 1 << 2;
    /// Bit of `flags`: smaller than any road user, so it is ranked behind objects that are not.
    pub const SMALL: u32 = 1 << 3;
    /// Bit of `flags`: larger than any road user, ranked likewise.
    pub const LARGE: u32 = 1 << 4;
    /// Bit of `flags`: too high for the ground it stands on (a post, a sign, a trunk), ranked likewise.
    pub const POST: u32 = 1 << 5;
    /// Bit of `flags`: its track is worth an alarm.
    pub const CONFIRMED: u32 = 1 << 6;
    /// The bytes of `flags` that are numbers: the first bit of each, and steps per unit. The byte is one more than the number of steps.
    const AGE_SCANS: (u32, f32) = (8, 1.0);
    const SPEED_MPS: (u32, f32) = (16, 4.0);
    const PROBABILITY: (u32, f32) = (24, 254.0);
    /// The bits of `flags` and their names in the JSON lines, in order.
    pub const FLAG_NAMES: [&'static str; 7] =
        ["unrefined", "split", "thinned", "small", "large", "post", "confirmed"];

    /// Checks a whole message: version, stamps, count, enums, indices, finite numbers. A published object must also have a size
    /// above 0 and a convex outline of three corners or more, counter-clockwise.
    pub fn checked<'a>(
        header: &FrameHeader,
        objects: &'a [Object],
        classes: usize,
    ) -> Result<&'a [Object]> {
        header.checked()?.checked_stamps(Stage::Refiner)?;
        check_length("objects", objects.len(), OBJECTS_MAX)?;
        for (index, o) in objects.iter().enumerate() {
            o.check(index, objects.len(), classes)?;
            o.check_meaning(index, objects)?;
        }
        Ok(objects)
    }

    fn check(&self, index: usize, objects: usize, classes: usize) -> Result<()> {
        check_value("kind of an object", self.kind, 2)?;
        let dispositions = Disposition::NAMES.len();
        check_value("disposition of an object", self.disposition, dispositions)?;
        check_value("gate of an object", self.gate, GateKind::NAMES.len())?;
        if self.suppressed_by != Object::NONE {
            check_index("suppressing object", self.suppressed_by as usize, objects)?;
        }
        check_index("class", self.class_id as usize, classes)?;
        let corners = self.footprint_count as usize;
        check_length("footprint corners", corners, FOOTPRINT_MAX)?;
        check_length("object points", self.points_end(), OBJECT_POINTS_MAX)?;
        let corners = &self.footprint_m[..corners];
        let is_told = is_probability_or_none(self.unknown_probability);
        let are_finite = |numbers: &[f32]| numbers.iter().all(|number| number.is_finite());
        let fields = [
            ("center_m of an object", are_finite(&self.center_m)),
            ("size_m of an object", are_finite(&self.size_m)),
            ("yaw_rad of an object", self.yaw_rad.is_finite()),
            ("score of an object", self.score.is_finite()),
            ("eds of an object", self.eds.is_finite()),
            ("eds_normalised of an object", self.eds_normalised.is_finite()),
            ("threshold of an object", self.threshold.is_finite()),
            ("overlap of an object", self.overlap.is_finite()),
            ("footprint_m of an object", are_finite(corners.as_flattened())),
            ("unknown_probability of an object", is_told),
        ];
        check_numbers(index, fields)
    }

    /// Checks what the disposition implies.
    fn check_meaning(&self, index: usize, objects: &[Object]) -> Result<()> {
        let unless = |holds, what| require(holds, ContractError::Inconsistent { what, index });
        let suppressor = objects.get(self.suppressed_by as usize);
        let expected = match self.disposition {
            d if d == Disposition::OverlapsKnown as u32 => Some(ObjectKind::Known as u32),
            d if d == Disposition::OverlapsUnknown as u32 => Some(ObjectKind::Unknown as u32),
            _ => None,
        };
        let is_own = self.suppressed_by == index as u32;
        let is_right = expected.is_none() || suppressor.map(|o| o.kind) == expected;
        unless(!is_own && is_right, "which object suppresses an object")?;
        unless((0.0..=1.0).contains(&self.overlap), "overlap of an object")?;
        if !self.is_published() {
            return Ok(());
        }
        let is_sized = self.size_m.iter().all(|&side| side > 0.0);
        unless(is_sized, "size of a published object")?;
        unless(self.has_sound_outline(), "outline of a published object")
    }

    /// Three corners or more, counter-clockwise and convex: no corner lies to the right of a side. The tolerance is 1 mm plus
    /// the rounding of f32 far from the sensor.
    fn has_sound_outline(&self) -> bool {
        let corners = &self.footprint_m[..self.footprint_count as usize];
        let far_m = corners.iter().flatten().fold(0.0f32, |far, v| far.max(v.abs()));
        let slack_m = 1e-3 + 1e-6 * f64::from(far_m);
        let is_left = |a: &[f32; 2], b: &[f32; 2], c: &[f32; 2]| {
            let from_a =
                |to: &[f32; 2]| [0, 1].map(|axis| f64::from(to[axis]) - f64::from(a[axis]));
            let ([bx, by], [cx, cy]) = (from_a(b), from_a(c));
            // Twice the area of the triangle, against its height times its longest side.
            bx * cy - by * cx >= -slack_m * (bx.abs() + by.abs() + cx.abs() + cy.abs())
        };
        let sides = corners.iter().zip(corners.iter().cycle().skip(1));
        let is_convex = |(a, b)| corners.iter().all(|c| is_left(a, b, c));
        corners.len() >= 3 && sides.into_iter().all(is_convex)
    }

    /// Checks that the points of all objects lie inside of the `object_points` message of the frame.
    pub fn checked_ranges(objects: &[Object], object_points: usize) -> Result<()> {
        let what = "range of an object's points";
        let end = objects.iter().map(Object::points_end).max().unwrap_or(0);
        check_length(what, end, object_points)
    }

    /// Checks an `object_points` message: version, count, and every index against the `points` of the scan.
    pub fn checked_points<'a>(
        header: &FrameHeader,
        indices: &'a [u32],
        points: usize,
    ) -> Result<&'a [u32]> {
        header.checked()?;
        check_length("object points", indices.len(), OBJECT_POINTS_MAX)?;
        if let Some(&largest) = indices.iter().max() {
            check_index("point of an object", largest as usize, points)?;
        }
        Ok(indices)
    }

    /// One more than its last entry in `object_points`.
    fn points_end(&self) -> usize {
        self.points_first as usize + self.points_count as usize
    }

    /// How likely it is an object of its kind: of the validation objects with its score, at its range, the share that were; to 0.4 %.
    /// `None`: it is not given.
    pub fn probability(&self) -> Option<f32> {
        self.told(Object::PROBABILITY)
    }

    /// Sets [`Object::probability`], 0 to 1.
    pub fn tell_probability(&mut self, probability: f32) {
        self.tell(Object::PROBABILITY, probability);
    }

    /// The data of its track; `None` without a track.
    pub fn track(&self) -> Option<TrackNews> {
        Some(TrackNews {
            age_scans: self.told(Object::AGE_SCANS)? as u32,
            speed_mps: self.told(Object::SPEED_MPS),
            is_confirmed: self.flags & Object::CONFIRMED != 0,
        })
    }

    /// Sets the number and the data of its track.
    pub fn tell_track(&mut self, track_id: u32, news: TrackNews) {
        self.track_id = track_id;
        self.tell(Object::AGE_SCANS, news.age_scans as f32);
        if let Some(speed_mps) = news.speed_mps {
            self.tell(Object::SPEED_MPS, speed_mps);
        }
        self.flags |= [0, Object::CONFIRMED][usize::from(news.is_confirmed)];
    }

    /// The number in the byte of `flags` that begins at a bit; `None` if the byte is 0.
    fn told(&self, (bit, steps): (u32, f32)) -> Option<f32> {
        let byte = self.flags >> bit & 0xff;
        (byte > 0).then(|| (byte - 1) as f32 / steps)
    }

    fn tell(&mut self, (bit, steps): (u32, f32), value: f32) {
        let steps = (value * steps).round().clamp(0.0, 254.0) as u32;
        self.flags = self.flags & !(0xff << bit) | (steps + 1) << bit;
    }

    /// Published, and not suppressed.
    pub fn is_published(&self) -> bool {
        self.disposition == Disposition::Published as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A change, and how the error about it begins.
    type Change = (fn(&mut Object), &'static str);

    fn object() -> Object {
        outlined(&[[1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.0, 0.0]])
    }

    fn outlined(corners_m: &[[f32; 2]]) -> Object {
        let mut object = Object {
            suppressed_by: Object::NONE,
            size_m: [1.0; 3],
            footprint_count: corners_m.len() as u32,
            ..Object::zeroed()
        };
        object.footprint_m[..corners_m.len()].copy_from_slice(corners_m);
        object
    }

    /// The error about an object with one field changed; empty: it passes.
    fn said(change: fn(&mut Object)) -> String {
        let mut object = object();
        change(&mut object);
        said_of(object)
    }

    fn said_of(object: Object) -> String {
        Object::checked(&FrameHeader::new(0, "a"), &[object], 3)
            .map_or_else(|error| error.to_string(), |_| String::new())
    }

    #[test]
    fn what_breaks_the_contract_is_named() {
        assert_eq!(said(|_| ()), "");
        assert_eq!(said(|o| o.footprint_count = FOOTPRINT_MAX as u32), "");
        // A corner that is not in use.
        assert_eq!(said(|o| o.footprint_m[4][0] = f32::NAN), "");
        // An object that is not published needs no size and no outline.
        let flat = said(|o| (o.disposition, o.size_m, o.footprint_count) = (5, [0.0; 3], 0));
        assert_eq!(flat, "");
        let changes: [Change; 19] = [
            (|o| o.kind = 2, "kind of an object: 2 is"),
            (|o| o.disposition = 9, "disposition of an object: 9 is"),
            (|o| o.gate = 4, "gate of an object: 4 is"),
            (|o| o.class_id = 3, "class: index 3 outside of 3"),
            (|o| o.suppressed_by = 1, "suppressing object: index 1"),
            (|o| o.footprint_count = 17, "footprint corners: 17"),
            (|o| o.points_first = 131_073, "object points: 131073"),
            (|o| o.points_count = u32::MAX, "object points: 4294967295"),
            (|o| o.center_m[1] = f32::NAN, "center_m of an object: entry 0"),
            (|o| o.size_m[2] = f32::INFINITY, "size_m of an object: entry 0"),
            (|o| o.eds = f32::NAN, "eds of an object: entry 0"),
            (|o| o.footprint_m[3][1] = -f32::INFINITY, "footprint_m of an object: entry 0"),
            (|o| o.size_m[1] = 0.0, "size of a published"),
            (|o| o.size_m[2] = -1.0, "size of a published"),
            (|o| o.footprint_count = 2, "outline of a published"),
            (|o| o.overlap = 1.5, "overlap of an object: entry 0"),
            (|o| o.overlap = -0.5, "overlap of an object: entry 0"),
            (|o| o.suppressed_by = 0, "which object suppresses"),
            (|o| o.disposition = 1, "which object suppresses"),
        ];
        for (change, expected) in changes {
            let error = said(change);
            assert!(error.starts_with(expected), "{expected}: {error}");
        }
        let far = Object { points_first: u32::MAX, points_count: u32::MAX, ..object() };
        assert!(Object::checked(&FrameHeader::new(0, "a"), &[far], 3).is_err());
    }

    #[test]
    fn numbers_are_told_in_the_flags_and_leave_the_others() {
        let mut object = object();
        object.flags = Object::SPLIT;
        assert_eq!(object.probability(), None);
        for told in [0.0, 0.3, 1.0, 7.0, -1.0] {
            object.tell_probability(told);
            let found = object.probability().expect("told");
            assert!((found - told.clamp(0.0, 1.0)).abs() < 0.002, "{found}");
            assert_eq!(object.flags & 0xff_ffff, Object::SPLIT);
        }
        assert_eq!(object.track(), None);
        for (age_scans, speed_mps) in [(0, None), (7, Some(2.5)), (254, Some(63.5))] {
            let news = TrackNews { age_scans, speed_mps, is_confirmed: age_scans > 0 };
            object.tell_track(3, news);
            assert_eq!((object.track(), object.track_id), (Some(news), 3));
        }
        assert_eq!(object.probability(), Some(0.0));
        assert_eq!(object.flags & 0xff, Object::SPLIT | Object::CONFIRMED);
    }

    #[test]
    fn the_outline_of_what_is_published_is_convex_and_counter_clockwise() {
        let [a, b, c, d] = [[60.0, 1.0], [58.0, 1.0], [58.0, -1.0], [60.0, -1.0]];
        let hardly_dented = [a, [59.0, 0.9995], b, c, d];
        for corners in [&[a, b, c, d][..], &[a, b, c], &[a, a, b, c, d], &hardly_dented] {
            assert_eq!(said_of(outlined(corners)), "", "{corners:?}");
        }
        // Outlines of discs, rounded to f32, also if corners coincide.
        for (x_m, radius_m) in [(100.0, 0.01), (9e3, 3.0), (1e30, 1.0), (0.0, 1e37f32)] {
            let disc: [_; FOOTPRINT_MAX] = std::array::from_fn(|k| {
                let angle = k as f32 * std::f32::consts::TAU / FOOTPRINT_MAX as f32;
                [x_m + radius_m * angle.cos(), radius_m * angle.sin()]
            });
            assert_eq!(said_of(outlined(&disc)), "", "{x_m} {radius_m}");
        }
        let star = [0.0, 2.0, 4.0, 1.0, 3.0].map(|k| {
            let angle = std::f32::consts::TAU * k / 5.0;
            [2.0 * angle.cos(), 2.0 * angle.sin()]
        });
        let dented = [a, [59.0, 0.99], b, c, d];
        let clockwise = [d, c, b, a];
        for corners in [&[a, b][..], &clockwise, &[a, c, b, d], &dented, &star] {
            let said = said_of(outlined(corners));
            let expected = "outline of a published";
            assert!(said.starts_with(expected), "{corners:?}: {said}");
        }
        let mut unpublished = outlined(&clockwise);
        unpublished.disposition = Disposition::TooFewPoints as u32;
        assert_eq!(said_of(unpublished), "");
    }

    #[test]
    fn suppressors_stamps_and_ranges_are_checked() {
        let covered = Object {
            disposition: Disposition::OverlapsUnknown as u32,
            suppressed_by: 1,
            ..object()
        };
        let header = FrameHeader::new(0, "a");
        let by_known = [covered, object()];
        assert!(Object::checked(&header, &by_known, 3).is_err());
        let mut by_unknown = by_known;
        by_unknown[1].kind = ObjectKind::Unknown as u32;
        assert!(Object::checked(&header, &by_unknown, 3).is_ok());
        let mut late = header;
        late.stamps_mut(Stage::Refiner).received_ns = u64::MAX;
        assert!(Object::checked(&late, &[], 3).is_err());
        assert!(Object::checked_ranges(&by_known, 0).is_ok());
        by_unknown[0].points_count = 5;
        assert!(Object::checked_ranges(&by_unknown, 5).is_ok());
        assert!(Object::checked_ranges(&by_unknown, 4).is_err());
    }

    #[test]
    fn point_indices_are_checked_against_the_scan() {
        let check = |indices: &[u32]| {
            Object::checked_points(&FrameHeader::new(0, "a"), indices, 10).map(<[u32]>::to_vec)
        };
        assert_eq!(check(&[0, 9]), Ok(vec![0, 9]));
        let error = check(&[0, 10]).unwrap_err();
        assert!(matches!(error, ContractError::Index(_, _, 10)));
    }
}
