//! What a training run can be told.

use std::path::PathBuf;

use mluc_model::{Beams, Grid, Manifest, Network};
use serde::{Deserialize, Serialize};

use super::error::TrainError;

/// Classes, range and anchors (paper section 4.1).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Setting {
    /// All around; car, pedestrian, cyclist, truck.
    Udi,
    /// To the front; car, pedestrian, cyclist.
    Kitti,
}

/// Size of the network.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Profile {
    /// For a few cores.
    Compact,
    /// The paper's.
    Second,
}

/// A training run. What changes the weights is compared when a run is resumed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// Classes and range.
    pub setting: Setting,
    /// Network.
    pub profile: Profile,
    /// Folder with `train/` and `val/`.
    pub data: PathBuf,
    /// Folder of the run.
    pub out: PathBuf,
    /// Optimiser steps.
    pub steps: u64,
    /// Frames a step.
    pub batch: usize,
    /// Of weights, order and augmentation.
    pub seed: u64,
    /// Highest rate of the cycle.
    pub learning_rate: f64,
    /// T; by default C, the paper's.
    pub prototype_scale: f32,
    /// Weight of the variance loss; 0 in the paper.
    pub variance_weight: f32,
    /// Multiply in bf16.
    pub bf16: bool,
    /// Paste, flip, turn and scale.
    pub augment: bool,
    /// Frames that give objects to paste.
    pub database_frames: usize,
    /// Frames of `val/` that judge the model after every epoch and at the end; 0: none.
    pub validate_frames: usize,
    /// Commit of the trainer, for the model file.
    pub commit: String,
    /// Steps between checkpoints.
    pub checkpoint_every: u64,
}

impl Setting {
    /// `udi` or `kitti`.
    pub fn name(self) -> &'static str {
        match self {
            Setting::Udi => "udi",
            Setting::Kitti => "kitti",
        }
    }

    /// Known classes.
    pub fn classes(self) -> usize {
        match self {
            Setting::Udi => 4,
            Setting::Kitti => 3,
        }
    }

    /// Objects of each class that a frame holds after pasting (paper's implementation for KITTI; a choice for UDI).
    pub fn objects_wanted(self) -> &'static [usize] {
        match self {
            Setting::Udi => &[8, 10, 10, 5],
            Setting::Kitti => &[15, 10, 10],
        }
    }
}

impl Settings {
    /// Checks ranges.
    pub fn check(&self) -> Result<(), TrainError> {
        let wrong = |name, expected, found: String| {
            Err(TrainError::Setting {
                name,
                expected,
                found,
            })
        };
        match () {
            () if self.steps == 0 => wrong("--steps", "1 or more", "0".into()),
            () if !(1..=64).contains(&self.batch) => {
                wrong("--batch", "1 to 64", self.batch.to_string())
            }
            () if !(self.learning_rate > 0.0 && self.learning_rate < 1.0) => wrong(
                "--learning-rate",
                "above 0 and below 1",
                self.learning_rate.to_string(),
            ),
            () if !(0.1..=100.0).contains(&self.prototype_scale) => wrong(
                "--prototype-scale",
                "0.1 to 100",
                self.prototype_scale.to_string(),
            ),
            () if !(0.0..=100.0).contains(&self.variance_weight) => wrong(
                "--variance-weight",
                "0 to 100",
                self.variance_weight.to_string(),
            ),
            () => Ok(()),
        }
    }

    /// The network to train.
    pub fn network(&self) -> Network {
        let classes = self.setting.classes();
        match (self.profile, self.setting) {
            (Profile::Compact, Setting::Udi) => {
                Network::compact(Grid::udi(), classes).with_reach_of_trucks()
            }
            (Profile::Compact, Setting::Kitti) => Network::compact(Grid::kitti_compact(), classes),
            (Profile::Second, Setting::Udi) => Network::second(Grid::udi(), classes),
            (Profile::Second, Setting::Kitti) => Network::second(Grid::kitti_second(), classes),
        }
    }

    /// The manifest before training: what the data decides is filled in later.
    pub fn manifest(&self) -> Manifest {
        Manifest {
            uses_intensity: false,
            prototype_scale: self.prototype_scale,
            beams: hdl_64e(),
            ..Manifest::untrained(self.setting.name(), self.network())
        }
    }

    /// What a resumed run must share with its beginning, as text. The number of steps may change: the cycle then goes on
    /// from the same step, at the rate that the new number gives it.
    pub fn fingerprint(&self) -> String {
        format!(
            "{} {:?} batch {} seed {} rate {} scale {} variance {} augment {} database {} bf16 {}",
            self.setting.name(),
            self.profile,
            self.batch,
            self.seed,
            self.learning_rate,
            self.prototype_scale,
            self.variance_weight,
            self.augment,
            self.database_frames,
            self.bf16
        )
    }
}

/// The beams of a Velodyne HDL-64E (nominal values of public calibrations, as the simulator casts them; real sensors lie
/// within some 0.1 deg), from the top down, and the step between columns at 10 Hz.
pub fn hdl_64e() -> Beams {
    let upper = (0..32).map(|i| 2.02 - 0.34 * i as f32);
    let lower = (0..32).map(|i| -8.95 - 0.5084 * i as f32);
    Beams {
        elevation_rad: upper.chain(lower).map(f32::to_radians).collect(),
        azimuth_step_rad: 0.1728f32.to_radians(),
    }
}
