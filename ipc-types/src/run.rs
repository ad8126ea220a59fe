//! The data that apply to all frames of one run of a pipeline, and which frames belong to it.

use crate::error::{Result, check_value, check_version, require};
use crate::{
    CLASS_NAME_MAX, CLASSES_MAX, ContractError, FrameHeader, GateKind, MEANING_MAX, RUN_NAME_MAX,
    Text,
};
use bytemuck::{Pod, Zeroable};
#[cfg(feature = "iceoryx2")]
use iceoryx2::prelude::ZeroCopySend;
use std::ops::Range;

/// The one message of the topic `run`: what a stage or a consumer must know besides the frames.
///
/// Its one writer is the supervisor; where stages run without a supervisor, ingest. The topic keeps the message for late readers (history 1). A new description
/// begins a new run: its `run_id` differs, its sequences begin at 0, and messages of the run before must not be used any more. With the same `run_id` it has
/// other thresholds, or another model with the same classes. `mluc_runtime::Shell` follows the topic for its process.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[cfg_attr(feature = "iceoryx2", derive(ZeroCopySend))]
#[cfg_attr(feature = "iceoryx2", type_name("mluc.RunDescription"))]
#[repr(C)]
pub struct RunDescription {
    /// [`crate::WIRE_VERSION`] of the writer.
    pub wire_version: u32,
    /// Known classes of the model, 1 to [`CLASSES_MAX`].
    pub classes_count: u32,
    /// Random at each start of a pipeline, never 0; every header and heartbeat of the run carries it.
    pub run_id: u64,
    /// When the run began: CLOCK_REALTIME, ns since 1970.
    pub started_ns: u64,
    /// Fingerprint of the model file; every header of the run carries it.
    pub model_fingerprint: u64,
    /// If the run changes its model: fingerprint of the next model until it takes over, then of the last one. Its frames are valid too. 0: none.
    pub other_model_fingerprint: u64,
    /// Where the sensor sits on the robot: x, y, z in m, roll, pitch, yaw in rad. A point p of the sensor frame lies at
    /// R p + (x, y, z) in the base frame, R = Rz(yaw) Ry(pitch) Rx(roll). Zeros are the identity.
    pub base_from_sensor: [f64; 6],
    /// Height above the ground that the model was made for, m.
    pub sensor_height_m: f32,
    /// Boxes below this objectness are not in the detections.
    pub objectness_min: f32,
    /// [`GateKind`]: the gate that decides which boxes of the model are candidate unknowns.
    pub gate: u32,
    /// That gate's threshold, in the gate's own unit; 0 without a gate.
    pub gate_threshold: f32,
    /// The model's name, UTF-8, NUL-padded.
    pub model_name: [u8; RUN_NAME_MAX],
    /// The sensor profile's name, UTF-8, NUL-padded; empty when it has none.
    pub sensor_name: [u8; RUN_NAME_MAX],
    /// Names by class id, UTF-8, NUL-padded; `classes_count` of them are in use.
    pub class_names: [[u8; CLASS_NAME_MAX]; CLASSES_MAX],
    /// What the score of a known object means, UTF-8, NUL-padded.
    pub known_score: [u8; MEANING_MAX],
    /// What the score of an unknown object means, UTF-8, NUL-padded.
    pub unknown_score: [u8; MEANING_MAX],
}

const _: () = assert!(
    size_of::<RunDescription>()
        == 104 + 2 * RUN_NAME_MAX + CLASSES_MAX * CLASS_NAME_MAX + 2 * MEANING_MAX
);

impl RunDescription {
    /// Checks version, run id, class count, gate, numbers and texts.
    pub fn checked(&self) -> Result<&RunDescription> {
        let value = |holds, what, found| require(holds, ContractError::Value { what, found });
        check_version(self.wire_version)?;
        value(self.run_id != 0, "id of the run", 0)?;
        let classes = self.classes_count;
        let has_classes = (1..=CLASSES_MAX as u32).contains(&classes);
        value(has_classes, "number of classes", classes)?;
        check_value("gate of the run", self.gate, GateKind::NAMES.len())?;
        let thresholds = [self.objectness_min, self.gate_threshold];
        let numbers = [self.sensor_height_m].into_iter().chain(thresholds);
        let mut numbers = numbers.map(f64::from).chain(self.base_from_sensor);
        let names = [&self.model_name, &self.sensor_name].map(|name| &name[..]);
        let meanings = [&self.known_score, &self.unknown_score].map(|text| &text[..]);
        let class_names = self.class_names.iter().map(|name| &name[..]);
        let mut texts = names.into_iter().chain(meanings).chain(class_names);
        let are_sound = numbers.all(f64::is_finite) && texts.all(|t| Text::unpack(t).is_some());
        let (what, index) = ("numbers and texts of the run", 0);
        require(are_sound, ContractError::NotFinite { what, index })?;
        Ok(self)
    }

    /// Names of the classes by class id.
    pub fn class_names(&self) -> impl Iterator<Item = &str> {
        let count = (self.classes_count as usize).min(CLASSES_MAX);
        self.class_names[..count].iter().map(|name| Text::unpack(name).unwrap_or("?"))
    }

    /// The model's name; `?` when it is not UTF-8.
    pub fn model_name(&self) -> &str {
        Text::unpack(&self.model_name).unwrap_or("?")
    }
}

impl FrameHeader {
    /// Refuses a message of another wire version, run or model, and a sequence outside of `sequences`: from the last one
    /// seen (a frame may be sent again) to what ingest has sent.
    pub fn checked_in(&self, run: &RunDescription, sequences: Range<u64>) -> Result<&FrameHeader> {
        self.checked()?;
        let (expected, found) = (run.run_id, self.run_id);
        let other = ContractError::OtherRun { expected, found };
        require(found == expected, other)?;
        // While a run changes its model, frames of both models are valid.
        if self.model_fingerprint == 0 || self.model_fingerprint != run.other_model_fingerprint {
            self.check_model(run.model_fingerprint)?;
        }
        let (Range { start: first, end }, found) = (sequences, self.sequence);
        let is_sent = (first..end).contains(&found);
        require(is_sent, ContractError::Sequence { first, end, found })?;
        Ok(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::WIRE_VERSION;

    #[test]
    fn a_description_is_checked() {
        let mut class_names = [[0; CLASS_NAME_MAX]; CLASSES_MAX];
        class_names[1] = Text::pack("pedestrian");
        let sound = RunDescription {
            wire_version: WIRE_VERSION,
            classes_count: 2,
            run_id: 7,
            model_name: Text::pack("kitti"),
            class_names,
            ..RunDescription::zeroed()
        };
        assert!(sound.checked().is_ok());
        assert_eq!(sound.model_name(), "kitti");
        assert_eq!(sound.class_names().collect::<Vec<_>>(), ["", "pedestrian"]);
        let changes: [fn(&mut RunDescription); 8] = [
            |run| run.wire_version += 1,
            |run| run.run_id = 0,
            |run| run.classes_count = 0,
            |run| run.classes_count = CLASSES_MAX as u32 + 1,
            |run| run.gate = 9,
            |run| run.gate_threshold = f32::NAN,
            |run| run.base_from_sensor[5] = f64::INFINITY,
            |run| run.class_names[0] = [0xff; CLASS_NAME_MAX],
        ];
        for (number, change) in changes.into_iter().enumerate() {
            let mut run = sound;
            change(&mut run);
            assert!(run.checked().is_err(), "change {number}");
        }
    }
}
