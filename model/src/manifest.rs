//! The model file's metadata: what a model was trained for, and with which data and settings.

use crate::network::{Network, is_default};
use serde::{Deserialize, Serialize};

/// A known class and its anchors (two rotations, 0 and 1.57 rad).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AnchorClass {
    /// Lower case: `car`, `pedestrian`, `cyclist`, `truck`.
    pub name: String,
    /// l, w, h, m: the mean of the training split.
    pub size_m: [f32; 3],
    /// z of the box bottom, m: in the sensor frame; above the ground for local input.
    pub bottom_z_m: f32,
    /// Anchors at or above this bird's-eye overlap are positive.
    pub matched_iou: f32,
    /// Anchors below this overlap are negative.
    pub unmatched_iou: f32,
}

/// The head's and the gate's settings, chosen on the validation split.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Thresholds {
    /// Anchors below this objectness are not candidates.
    pub objectness_min: f32,
    /// Maximum number of candidates that enter non-maximum suppression, best first.
    pub candidates_max: u32,
    /// Rotated bird's-eye overlap above which the weaker box is dropped.
    pub nms_iou: f32,
    /// Maximum number of boxes kept after suppression.
    pub boxes_max: u32,
    /// A box with normalised EDS below this is a candidate unknown (paper section 3.2; the paper's lambda divided by
    /// (C-1) T^2). 0: the gate never fires, which gives the closed-set detector.
    pub eds_normalised_max: f32,
    /// A box whose largest class probability is below this is a candidate unknown. 0: no box is.
    #[serde(default, skip_serializing_if = "is_default")]
    pub softmax_min: f32,
    /// For an open head: a box is a candidate unknown if its probability of being none of the known classes is at least this.
    /// Boxes of class-agnostic anchors are dropped below this, or below one half. 0: no box is a candidate unknown.
    #[serde(default, skip_serializing_if = "is_default")]
    pub unknown_min: f32,
    /// What the operating profiles publish; absent in a model for which it was not chosen.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub profiles: Option<Profiles>,
    /// The probabilities that belong to scores; absent in a model for which they were not measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub probabilities: Option<Probabilities>,
}

/// Objects below these scores are not published. By default all objects are published.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScoreMin {
    /// Minimum score of known objects.
    pub known: f32,
    /// Minimum score of unknown objects, on the scale of the refiner with which the model was evaluated.
    pub unknown: f32,
    /// Whether a box that may be known or unknown is published as both.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub both_readings: bool,
}

/// The minimum scores of each operating profile except `all`, which publishes everything.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Profiles {
    /// The profile with few false objects.
    pub quiet: ScoreMin,
    /// The default profile.
    pub balanced: ScoreMin,
}

impl Profiles {
    /// Each profile with its name.
    pub fn named(&self) -> [(&'static str, ScoreMin); 2] {
        [("quiet", self.quiet), ("balanced", self.balanced)]
    }
}

/// Probability, by range, that an object with a score is one of its kind: the share of the validation objects that lie on a label of their kind.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Probabilities {
    /// Bands for known objects of any class, nearest band first.
    pub known: Vec<RangeBand>,
    /// Bands for unknown objects, on the score scale of the refiner with which the model was evaluated.
    pub unknown: Vec<RangeBand>,
}

/// The scores and probabilities of a band of ranges.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RangeBand {
    /// Horizontal distance at which the band begins, m; it ends where the next band begins.
    pub range_min_m: f32,
    /// Score and probability, both ascending: interpolated linearly between two steps, constant before the first and after the last.
    pub steps: Vec<[f32; 2]>,
}

impl Probabilities {
    /// Probability of an object at this range (m) from the sensor; `None` without a table.
    pub fn of(&self, is_known: bool, range_m: f32, score: f32) -> Option<f32> {
        let bands = [&self.unknown, &self.known][usize::from(is_known)];
        let own = bands.iter().rfind(|band| band.range_min_m <= range_m);
        let steps = &own.or(bands.first())?.steps;
        let after = steps.partition_point(|step| step[0] <= score);
        let ([x0, y0], [x1, y1]) = match (after.checked_sub(1), steps.get(after)) {
            (Some(before), Some(next)) => (steps[before], *next),
            (None, Some(only)) => (*only, *only),
            (_, None) => (*steps.last()?, *steps.last()?),
        };
        let share = (x1 > x0).then(|| (score - x0) / (x1 - x0));
        Some(y0 + share.unwrap_or(0.0) * (y1 - y0))
    }
}

/// The sensor's beams, for range images; empty for a model for any sensor.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Beams {
    /// Elevation of each beam, rad, from the top down.
    pub elevation_rad: Vec<f32>,
    /// Azimuth step of a column, rad.
    pub azimuth_step_rad: f32,
}

/// The input that a model accepts; at run time, input outside these limits is flagged.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Takes {
    /// Minimum and maximum number of beams.
    pub beams: [u32; 2],
    /// Minimum and maximum height of the sensor above the ground, m.
    pub height_m: [f32; 2],
    /// Maximum angle between the sensor's vertical axis and the ground's normal, degrees.
    pub tilt_max_deg: f32,
    /// Minimum and maximum number of points per scan.
    pub points: [u32; 2],
}

impl Takes {
    /// Sensors similar to a given one: 0.6 to 1.6 times its beams, at most 0.5 m lower or higher (more costs most of the recall), at most 7 degrees
    /// of tilt, and 0.1 to 2 times its returns per turn. A number of 0 gives no limits. All limits but the height's are guesses.
    pub fn like(beams: f32, returns: f32, height_m: f32) -> Takes {
        let range = |value: f32, low: f32, high: f32| {
            if value > 0.0 {
                [(value * low) as u32, (value * high).ceil() as u32]
            } else {
                [0, u32::MAX]
            }
        };
        Takes {
            beams: range(beams, 0.6, 1.6),
            height_m: [(height_m - 0.5).max(0.05), (height_m + 0.5).min(10.0)],
            tilt_max_deg: 7.0,
            points: range(returns, 0.1, 2.0),
        }
    }
}

/// The origin of a model.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Provenance {
    /// Data set and seed.
    pub data: String,
    /// Random seed of the training run.
    pub seed: u64,
    /// Optimiser steps.
    pub steps: u64,
    /// Frames per step.
    pub batch: u32,
    /// Commit of the trainer, or `unknown`.
    pub commit: String,
    /// Validation figures by name, percent.
    pub metrics: std::collections::BTreeMap<String, f64>,
    /// How the gate's threshold was chosen: split and rule.
    pub threshold_choice: String,
    /// How the scores of the profiles were chosen; empty in a model without them.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub profile_choice: String,
    /// How the int8 ranges were chosen: frames and rule; empty in a model without them.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub calibration: String,
}

/// The model file's metadata.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// Version of this format: [`Manifest::FORMAT`].
    pub format: u32,
    /// Name: `kitti`, `udi`, or the user's own.
    pub name: String,
    /// Description of every layer.
    pub network: Network,
    /// Known classes in the order of the embedding's channels; `network.classes` entries.
    pub classes: Vec<AnchorClass>,
    /// Class-agnostic anchors; `network.generic` entries.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub generic: Vec<AnchorClass>,
    /// Height of the sensor above the ground, m.
    pub sensor_height_m: f32,
    /// Whether the network reads intensity; if not, that channel is 0.
    pub uses_intensity: bool,
    /// T: prototype t is T times the t-th unit vector (paper section 3.2).
    pub prototype_scale: f32,
    /// The largest objectness that the network gives to an empty scene. It is below `objectness_min`, so that a cell that is
    /// absent from the feature rows cannot contain a candidate.
    pub empty_objectness_max: f32,
    /// Settings chosen on validation data.
    pub thresholds: Thresholds,
    /// The beams that the model was trained on.
    pub beams: Beams,
    /// The input that the model accepts; if absent, [`Manifest::takes`] derives it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub takes: Option<Takes>,
    /// The origin of the model.
    pub provenance: Provenance,
}

impl Manifest {
    /// Files of another format are refused.
    pub const FORMAT: u32 = 1;

    /// Names of the classes, in the order of class ids.
    pub fn class_names(&self) -> Vec<String> {
        self.classes.iter().map(|c| c.name.clone()).collect()
    }

    /// The input that the model accepts. If the file does not define it: sensors similar to the one that the model was trained on.
    pub fn takes(&self) -> Takes {
        if let Some(takes) = &self.takes {
            return takes.clone();
        }
        let beams = self.beams.elevation_rad.len() as f32;
        let returns = beams * std::f32::consts::TAU / self.beams.azimuth_step_rad;
        Takes::like(beams, returns, self.sensor_height_m)
    }
}
