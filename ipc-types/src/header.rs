//! The header that every message carries: which frame, what happened to it, and when.

use crate::error::{Result, check_equal, check_version, require};
use crate::{ContractError, NAME_MAX, Text, WIRE_VERSION, text::values};
use bytemuck::{Pod, Zeroable};
#[cfg(feature = "iceoryx2")]
use iceoryx2::prelude::ZeroCopySend;

/// The stages in the order a frame meets them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[repr(u32)]
pub enum Stage {
    /// Brings a scan into shared memory.
    Ingest = 0,
    /// Voxels to feature rows.
    Backbone = 1,
    /// Feature rows to detections.
    Head = 2,
    /// Detections and points to objects.
    Refiner = 3,
}

values!(Stage: Ingest "ingest" Backbone "backbone" Head "head" Refiner "refiner");

/// When a stage received its input, began to compute and published: CLOCK_MONOTONIC, ns; 0 when it did not yet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[cfg_attr(feature = "iceoryx2", derive(ZeroCopySend))]
#[cfg_attr(feature = "iceoryx2", type_name("mluc.StageStamps"))]
#[repr(C)]
pub struct StageStamps {
    /// The message was taken from the queue (ingest: the scan was due or arrived).
    pub received_ns: u64,
    /// Computing began.
    pub started_ns: u64,
    /// The result was handed to shared memory.
    pub published_ns: u64,
}

/// What is out of the ordinary in a frame: bits of [`FrameHeader::flags`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Flags(pub u32);

impl Flags {
    /// The frame left later than its deadline.
    pub const LATE: Flags = Flags(1);
    /// Points beyond the limit were dropped.
    pub const TRUNCATED: Flags = Flags(1 << 1);
    /// A stage could not do all of its work (points of the frame gone, for instance).
    pub const DEGRADED: Flags = Flags(1 << 2);
    /// A limit was reached; our own stages also set one of the `LIMIT_` flags below, which says which limit.
    pub const LIMIT_HIT: Flags = Flags(1 << 3);
    /// The frame was sent again after silence or a restart.
    pub const RESENT: Flags = Flags(1 << 4);
    /// Points with NaN or infinity were dropped.
    pub const NOT_FINITE: Flags = Flags(1 << 5);
    /// The scan is damaged: its file or message is cut short or cannot be read, packets of the turn are missing, the turn is not whole, or the scan was set
    /// aside. What is complete is used.
    pub const DAMAGED_INPUT: Flags = Flags(1 << 6);
    /// The points of this sequence were gone when the refiner asked for them.
    pub const POINTS_GONE: Flags = Flags(1 << 7);
    /// The scan holds no point.
    pub const EMPTY: Flags = Flags(1 << 8);
    /// The input does not look like what the model takes, or like the given sensor; our ingest also sets the `SUSPECT_` flags below, which say why.
    pub const INPUT_SUSPECT: Flags = Flags(1 << 9);
    /// [`Flags::LIMIT_HIT`] of voxels: the points of a frame fill more voxels than the network takes.
    pub const LIMIT_VOXELS: Flags = Flags(1 << 10 | Flags::LIMIT_HIT.0);
    /// [`Flags::LIMIT_HIT`] of the boxes that the head decodes before it suppresses overlapping ones.
    pub const LIMIT_CANDIDATES: Flags = Flags(1 << 11 | Flags::LIMIT_HIT.0);
    /// [`Flags::LIMIT_HIT`] of detections: the head kept as many as a message can hold, or the refiner received more.
    pub const LIMIT_DETECTIONS: Flags = Flags(1 << 12 | Flags::LIMIT_HIT.0);
    /// [`Flags::LIMIT_HIT`] of the objects' points.
    pub const LIMIT_OBJECT_POINTS: Flags = Flags(1 << 13 | Flags::LIMIT_HIT.0);
    /// [`Flags::LIMIT_HIT`] of the refiner's work or time for a frame.
    pub const LIMIT_WORK: Flags = Flags(1 << 14 | Flags::LIMIT_HIT.0);
    /// [`Flags::INPUT_SUSPECT`] for too few or too many points, or points that are not finite, at one place, or duplicates.
    pub const SUSPECT_POINTS: Flags = Flags(1 << 15 | Flags::INPUT_SUSPECT.0);
    /// [`Flags::INPUT_SUSPECT`] for coordinates that are not in m, or not around the sensor.
    pub const SUSPECT_UNIT: Flags = Flags(1 << 16 | Flags::INPUT_SUSPECT.0);
    /// [`Flags::INPUT_SUSPECT`] because another axis than z points up.
    pub const SUSPECT_AXES: Flags = Flags(1 << 17 | Flags::INPUT_SUSPECT.0);
    /// [`Flags::INPUT_SUSPECT`] for the height of the sensor above the ground.
    pub const SUSPECT_HEIGHT: Flags = Flags(1 << 18 | Flags::INPUT_SUSPECT.0);
    /// [`Flags::INPUT_SUSPECT`] for the angle between the sensor's axis and the ground's.
    pub const SUSPECT_TILT: Flags = Flags(1 << 19 | Flags::INPUT_SUSPECT.0);
    /// [`Flags::INPUT_SUSPECT`] for the number of beams.
    pub const SUSPECT_BEAMS: Flags = Flags(1 << 20 | Flags::INPUT_SUSPECT.0);
    /// [`Flags::INPUT_SUSPECT`] for directions without returns.
    pub const SUSPECT_FIELD: Flags = Flags(1 << 21 | Flags::INPUT_SUSPECT.0);
    /// [`Flags::INPUT_SUSPECT`] for returns that end at one range everywhere.
    pub const SUSPECT_RANGE: Flags = Flags(1 << 22 | Flags::INPUT_SUSPECT.0);
    /// [`Flags::INPUT_SUSPECT`] for intensities that are not 0 to 1, or missing.
    pub const SUSPECT_INTENSITY: Flags = Flags(1 << 23 | Flags::INPUT_SUSPECT.0);
    /// [`Flags::INPUT_SUSPECT`] for a scan that repeats.
    pub const SUSPECT_FROZEN: Flags = Flags(1 << 24 | Flags::INPUT_SUSPECT.0);
    /// [`Flags::INPUT_SUSPECT`] for a sensor that is not the given one.
    pub const SUSPECT_SENSOR: Flags = Flags(1 << 25 | Flags::INPUT_SUSPECT.0);

    /// The names of the flags, by bit.
    const NAMES: &str = "late truncated degraded limit_hit resent not_finite damaged_input points_gone empty input_suspect \
        limit_voxels limit_candidates limit_detections limit_object_points limit_work suspect_points suspect_unit \
        suspect_axes suspect_height suspect_tilt suspect_beams suspect_field suspect_range suspect_intensity \
        suspect_frozen suspect_sensor";

    /// The union of both sets.
    pub fn with(self, other: Flags) -> Flags {
        Flags(self.0 | other.0)
    }

    /// Whether all of `other` is set.
    pub fn contains(self, other: Flags) -> bool {
        self.0 & other.0 == other.0
    }

    /// Names of the set bits, in order.
    pub fn names(self) -> impl Iterator<Item = &'static str> {
        let names = Flags::NAMES.split(' ').enumerate();
        names.filter_map(move |(bit, name)| (self.0 >> bit & 1 == 1).then_some(name))
    }
}

/// The pose of the sensor when the scan was taken, in a fixed frame (any fixed frame: only differences count).
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[cfg_attr(feature = "iceoryx2", derive(ZeroCopySend), type_name("mluc.EgoPose"))]
#[repr(C)]
pub struct EgoPose {
    /// x, y, z, m.
    pub position_m: [f64; 3],
    /// Heading about +z, rad.
    pub yaw_rad: f64,
    /// 0: not known; 1: from the source. The refiner marks its own estimates with 2; no message has these.
    pub is_known: u32,
    /// Always 0.
    pub reserved: u32,
}

impl EgoPose {
    /// A pose; `is_known`: 0 if it is not known, else a number for its source.
    pub fn new(position_m: [f64; 3], yaw_rad: f64, is_known: u32) -> EgoPose {
        EgoPose { position_m, yaw_rad, is_known, reserved: 0 }
    }
}

/// The header of every message of a frame; in the last message it has the stamps of all stages.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[cfg_attr(feature = "iceoryx2", derive(ZeroCopySend))]
#[cfg_attr(feature = "iceoryx2", type_name("mluc.FrameHeader"))]
#[repr(C)]
pub struct FrameHeader {
    /// [`WIRE_VERSION`] of the sender.
    pub wire_version: u32,
    /// Bits of [`Flags`].
    pub flags: u32,
    /// [`crate::RunDescription::run_id`] of the run that the frame belongs to; a message of another run is not used.
    pub run_id: u64,
    /// Counts the frames of one run from 0; a gap is a drop.
    pub sequence: u64,
    /// The sensor's own time, ns; it is passed on and never compared with the monotonic clock.
    pub sensor_stamp_ns: u64,
    /// Which sensor.
    pub sensor_id: u32,
    /// 0 for the first sending of a frame, then 1, 2.
    pub attempt: u32,
    /// Points that came in.
    pub points_in: u32,
    /// Points dropped: not finite, or beyond [`crate::POINTS_MAX`].
    pub points_dropped: u32,
    /// Points outside of the model's range; set by the backbone.
    pub points_out_of_range: u32,
    /// Rows of a features message.
    pub feature_rows: u32,
    /// Channels of a feature row.
    pub feature_channels: u32,
    /// Points, detections or objects that did not fit, or voxels beyond the limit.
    pub limit_dropped: u32,
    /// [`crate::RunDescription::model_fingerprint`]; a message with another one is refused.
    pub model_fingerprint: u64,
    /// Ego motion, where the source knows it.
    pub ego: EgoPose,
    /// The stamps of each [`Stage`].
    pub stages: [StageStamps; 4],
    /// The frame's name (file stem), UTF-8, NUL-padded.
    pub name: [u8; NAME_MAX],
}

const _: () = assert!(size_of::<FrameHeader>() == 72 + 40 + 4 * 24 + NAME_MAX);
const _: () = assert!(align_of::<FrameHeader>() == 8);

impl Default for FrameHeader {
    fn default() -> FrameHeader {
        FrameHeader::zeroed()
    }
}

impl FrameHeader {
    /// A new header that belongs to no run yet: the sender sets `run_id` and `model_fingerprint`.
    pub fn new(sequence: u64, name: &str) -> FrameHeader {
        FrameHeader {
            wire_version: WIRE_VERSION,
            sequence,
            name: Text::pack(FrameHeader::cut(name)),
            ..FrameHeader::zeroed()
        }
    }

    /// The part of a name that fits in a header: its end, which differs from scan to scan.
    pub fn cut(name: &str) -> &str {
        let over = name.len().saturating_sub(NAME_MAX);
        &name[name.ceil_char_boundary(over)..]
    }

    /// Counts and flags what a limit left out; does nothing if `dropped` is 0.
    pub fn count_over(&mut self, limit: Flags, dropped: u32) {
        if dropped > 0 {
            self.flag(limit);
            self.limit_dropped = self.limit_dropped.saturating_add(dropped);
        }
    }

    /// Whether its points can be a scan: at least 50 of them, and more than a twentieth, are finite and in the model's range. Of a
    /// text file read as points about 2 % are; of a scan at least a fifth are.
    pub fn is_usable(&self) -> bool {
        let unusable = self.points_dropped.saturating_add(self.points_out_of_range);
        self.points_in.saturating_sub(unusable) > (self.points_in / 20).max(49)
    }

    /// Refuses a message of another wire version.
    pub fn checked(&self) -> Result<&FrameHeader> {
        check_version(self.wire_version)?;
        Ok(self)
    }

    /// Refuses a frame of another model than a stage's.
    pub fn check_model(&self, fingerprint: u64) -> Result<()> {
        let what = "fingerprint of the model (all stages must run the same model)";
        check_equal(what, self.model_fingerprint, fingerprint)
    }

    /// Refuses stamps of a stage that do not ascend; zeros are fine.
    pub fn checked_stamps(&self, stage: Stage) -> Result<&FrameHeader> {
        let own = &self.stages[stage as usize];
        let ascend = own.received_ns <= own.started_ns
            && (own.started_ns <= own.published_ns || own.published_ns == 0);
        let (what, index) = ("order of a stage's stamps", stage as usize);
        require(ascend, ContractError::Inconsistent { what, index })?;
        Ok(self)
    }

    /// Adds flags.
    pub fn flag(&mut self, flags: Flags) {
        self.flags |= flags.0;
    }

    /// Stamps of one stage.
    pub fn stamps_mut(&mut self, stage: Stage) -> &mut StageStamps {
        &mut self.stages[stage as usize]
    }

    /// The frame's name; `?` when it is not UTF-8.
    pub fn name(&self) -> &str {
        Text::unpack(&self.name).unwrap_or("?")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fresh_header_passes_and_another_version_does_not() {
        let mut header = FrameHeader::new(4, "000004");
        assert_eq!(header.checked().map(|h| h.sequence), Ok(4));
        header.wire_version = WIRE_VERSION + 1;
        let text = header.checked().unwrap_err().to_string();
        let other = WIRE_VERSION + 1;
        let expected = format!("wire version {other} of the sender, expected {WIRE_VERSION}: ");
        assert!(text.starts_with(&expected), "{text}");
    }

    #[test]
    fn stamps_ascend() {
        let far = u64::MAX;
        let cases = [[0, 0, 0], [5, 7, 0], [5, 7, 6], [far, 7, 8]];
        for (stamps, ascend) in cases.into_iter().zip([true, true, false, false]) {
            let mut header = FrameHeader::new(0, "a");
            *header.stamps_mut(Stage::Head) = bytemuck::cast(stamps);
            assert_eq!(header.checked_stamps(Stage::Head).is_ok(), ascend);
        }
    }

    #[test]
    fn flags_have_names_in_order() {
        let mut header = FrameHeader::new(0, "a");
        header.flag(Flags::EMPTY.with(Flags::LATE));
        header.flag(Flags(1 << 31));
        let flags = Flags(header.flags);
        assert_eq!(flags.names().collect::<Vec<_>>(), ["late", "empty"]);
        assert!(flags.contains(Flags::EMPTY) && !flags.contains(Flags::TRUNCATED));
        assert_eq!(Flags(u32::MAX).names().last(), Some("suspect_sensor"));
    }

    #[test]
    fn a_long_name_is_cut_at_a_character_and_garbage_is_no_panic() {
        let long = "\u{e4}".repeat(40) + "b";
        let header = FrameHeader::new(0, &long);
        assert_eq!(header.name(), "\u{e4}".repeat(NAME_MAX / 2 - 1) + "b");
        let mut header = FrameHeader::new(0, "a");
        header.name = [0xff; NAME_MAX];
        assert_eq!(header.name(), "?");
    }
}
