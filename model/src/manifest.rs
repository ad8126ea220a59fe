//! What a model was trained for, and with what: the model file's metadata.

use serde::{Deserialize, Serialize};

use crate::network::{Network, is_default};

/// A known class and its anchors (two rotations, 0 and 1.57 rad).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AnchorClass {
    /// Lower case: `car`, `pedestrian`, `cyclist`, `truck`.
    pub name: String,
    /// l, w, h, m: the mean of the training split.
    pub size_m: [f32; 3],
    /// z of the box bottom in the sensor frame, m.
    pub bottom_z_m: f32,
    /// Anchors at or above this bird's-eye overlap are positive.
    pub matched_iou: f32,
    /// Anchors below it are negative.
    pub unmatched_iou: f32,
}

/// The head's and the gate's settings, chosen on the validation split.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Thresholds {
    /// Anchors below this objectness are no candidates.
    pub objectness_min: f32,
    /// The best so many enter non-maximum suppression.
    pub candidates_max: u32,
    /// Rotated bird's-eye overlap above which the weaker box goes.
    pub nms_iou: f32,
    /// Boxes kept after suppression.
    pub boxes_max: u32,
    /// A box with normalised EDS below this is a candidate unknown (paper section 3.2; the paper's lambda divided by
    /// (C-1) T^2). 0: the gate never fires, the closed-set detector.
    pub eds_normalised_max: f32,
    /// A box whose largest class probability is below this is a candidate unknown. 0: none is.
    #[serde(default, skip_serializing_if = "is_default")]
    pub softmax_min: f32,
    /// Of an open head: a box is a candidate unknown from this probability of being none of the known on; boxes of anchors
    /// without a class go below it, or below one half. 0: none is.
    #[serde(default, skip_serializing_if = "is_default")]
    pub unknown_min: f32,
    /// What the operating profiles publish; absent in a model for which nobody chose it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub profiles: Option<Profiles>,
    /// What scores are worth; absent in a model for which nobody measured it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub probabilities: Option<Probabilities>,
}

/// Objects below these scores are not published. By default all are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScoreMin {
    /// Of known objects.
    pub known: f32,
    /// Of unknown objects, on the scale of the refiner that the model was judged with.
    pub unknown: f32,
    /// A box that may be known or unknown is published as both: all that the model says.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub both_readings: bool,
}

/// The scores of each operating profile but `all`, which publishes everything.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Profiles {
    /// Few false objects.
    pub quiet: ScoreMin,
    /// The default.
    pub balanced: ScoreMin,
}

impl Profiles {
    /// Each with its name.
    pub fn named(&self) -> [(&'static str, ScoreMin); 2] {
        [("quiet", self.quiet), ("balanced", self.balanced)]
    }
}

/// How likely an object of a score is one of its kind, by range: the share of the validation objects that lie on a label of their kind.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Probabilities {
    /// Of known objects of any class, nearest band first.
    pub known: Vec<RangeBand>,
    /// Of unknown objects, on the scale of the refiner that the model was judged with.
    pub unknown: Vec<RangeBand>,
}

/// The scores of a band of ranges.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RangeBand {
    /// Where the band begins, m seen from above; it ends where the next one begins.
    pub range_min_m: f32,
    /// Score and probability, both ascending: along a line between two of them, and before and after all as at the end.
    pub steps: Vec<[f32; 2]>,
}

impl Probabilities {
    /// Of an object in this range from the sensor; `None` where there is no table.
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

/// The sensor's beams, for range images; none where it is any.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Beams {
    /// Elevation of each beam, rad, from the top down.
    pub elevation_rad: Vec<f32>,
    /// Azimuth step of a column, rad.
    pub azimuth_step_rad: f32,
}

/// Which input a model takes; what lies outside is flagged while it runs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Takes {
    /// Fewest and most beams.
    pub beams: [u32; 2],
    /// Lowest and highest place of the sensor above the ground, m.
    pub height_m: [f32; 2],
    /// Largest angle between the sensor's axis and the ground's, degrees.
    pub tilt_max_deg: f32,
    /// Fewest and most points a scan.
    pub points: [u32; 2],
}

impl Takes {
    /// Sensors like one: from 0.6 to 1.6 times its beams, 0.5 m lower or higher (more costs most of the recall), tilted by 7 degrees, and a tenth to twice of
    /// its returns a turn; any number where it names no beams. All but the height are guesses.
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

/// Where a model comes from.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Provenance {
    /// Data set and seed.
    pub data: String,
    /// Random seed of the training run.
    pub seed: u64,
    /// Optimiser steps.
    pub steps: u64,
    /// Frames a step.
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
    /// How the ranges of int8 were chosen: frames and rule; empty in a model without them.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub calibration: String,
}

/// The model file's metadata.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// Version of this format: [`Manifest::FORMAT`].
    pub format: u32,
    /// `kitti`, `udi`, or the user's own.
    pub name: String,
    /// Every layer.
    pub network: Network,
    /// In the order of the embedding's channels; `network.classes` of them.
    pub classes: Vec<AnchorClass>,
    /// Anchors without a class; `network.generic` of them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub generic: Vec<AnchorClass>,
    /// Height of the sensor above the ground, m.
    pub sensor_height_m: f32,
    /// Whether the network reads intensity; else that channel is 0.
    pub uses_intensity: bool,
    /// T: prototype t is T times the t-th unit vector (paper section 3.2).
    pub prototype_scale: f32,
    /// The largest objectness that the network gives to an empty scene: below `objectness_min`, so that a cell that is
    /// absent from the feature rows cannot hold a candidate.
    pub empty_objectness_max: f32,
    /// Settings chosen on validation data.
    pub thresholds: Thresholds,
    /// The beams trained on.
    pub beams: Beams,
    /// Which input it takes; absent: what [`Manifest::takes`] derives.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub takes: Option<Takes>,
    /// Where it comes from.
    pub provenance: Provenance,
}

impl Manifest {
    /// Files of another format are refused.
    pub const FORMAT: u32 = 1;

    /// Names of the classes, in the order of class ids.
    pub fn class_names(&self) -> Vec<String> {
        self.classes.iter().map(|c| c.name.clone()).collect()
    }

    /// Which input the model takes. Where the file does not say, sensors like the one it was trained on.
    pub fn takes(&self) -> Takes {
        if let Some(takes) = &self.takes {
            return takes.clone();
        }
        let beams = self.beams.elevation_rad.len() as f32;
        let returns = beams * std::f32::consts::TAU / self.beams.azimuth_step_rad;
        Takes::like(beams, returns, self.sensor_height_m)
    }
}
