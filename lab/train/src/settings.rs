//! The settings of a training run.

use std::path::PathBuf;

use mluc_dataset::{KITTI_CLASSES, SIMULATED_CLASSES};
use mluc_model::{AnchorClass, Beams, Manifest, Network, Takes};

use crate::error::TrainError;
use crate::kind::{Architecture, NetworkKind, Setting};
use crate::losses::LossSettings;

/// Cells of background that `metric-open` learns from: many, so that some look like an object. A guess.
const METRIC_OPEN_BACKGROUND_CELLS: usize = 512;

/// What [`NetworkKind::MlucFull`] and in part [`NetworkKind::MetricOpen`] add, each to be left out for an ablation.
#[derive(Clone, Debug, PartialEq)]
pub struct OpenSetSettings {
    /// Synthetic unknown objects pasted into a frame, at most; those that the data itself holds come on top.
    pub synthetic_unknown: usize,
    /// Weight of the loss that draws their embeddings to the prototypes' centre, and of [`NetworkKind::MetricOpen`] those of
    /// background away.
    pub center_loss_weight: f32,
    /// Weight of the logit of the unknown; of [`NetworkKind::MlucFull`] alone.
    pub unknown_weight: f32,
    /// Anchors without a class; of [`NetworkKind::MlucFull`] alone.
    pub class_agnostic_anchors: bool,
    /// Cells of a frame that hold points and no object, and are learned from as background.
    pub background_cells: usize,
}

impl Default for OpenSetSettings {
    /// Guesses, to be measured one by one.
    fn default() -> OpenSetSettings {
        OpenSetSettings {
            synthetic_unknown: 6,
            center_loss_weight: 0.5,
            unknown_weight: 1.0,
            class_agnostic_anchors: true,
            background_cells: 64,
        }
    }
}

/// A training run. What changes the weights is compared when a run is resumed.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainSettings {
    /// Classes and range.
    pub setting: Setting,
    /// The classes to learn, lower case; empty: the setting's.
    pub known: Vec<String>,
    /// Size of the network.
    pub architecture: Architecture,
    /// What its heads learn.
    pub kind: NetworkKind,
    /// A model file, or the folder of a run, whose weights are taken where they fit.
    pub init: Option<PathBuf>,
    /// Of kinds that [learn from synthetic unknown objects](NetworkKind::learns_from_synthetic_unknown) alone.
    pub open_set: OpenSetSettings,
    /// Of [`NetworkKind::MlucFull`] alone: fit the layers that score clusters. On by default for UDI. No known class of KITTI's is as
    /// large as a truck, so that there the layers take trucks for walls.
    pub cluster_scorer: bool,
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
    /// Multiply gradients of layers' inputs in bf16.
    pub bf16: bool,
    /// Paste, flip, turn and scale.
    pub augment: bool,
    /// Frames that give objects to paste.
    pub database_frames: usize,
    /// Frames of `val/` that judge the model after every epoch and at the end; 0: none.
    pub validate_frames: usize,
    /// Classes that labels name and the network does not know, beside KITTI's and the simulator's: their place teaches nothing.
    pub ignored_classes: Vec<String>,
    /// Commit of the trainer, for the model file.
    pub commit: String,
    /// Steps between checkpoints.
    pub checkpoint_every: u64,
}

impl TrainSettings {
    /// The defaults.
    pub fn new(
        setting: Setting,
        architecture: Architecture,
        kind: NetworkKind,
        data: PathBuf,
        out: PathBuf,
    ) -> TrainSettings {
        let is_full = kind == NetworkKind::MlucFull;
        let is_open = kind.learns_from_synthetic_unknown();
        let mut open_set = OpenSetSettings::default();
        if kind == NetworkKind::MetricOpen {
            open_set.background_cells = METRIC_OPEN_BACKGROUND_CELLS;
        }
        // An object cut out of one sensor's scan is none of another's.
        let pastes = setting != Setting::Any;
        if !pastes {
            open_set.synthetic_unknown = 0;
        }
        let classes = setting.classes() as f32;
        TrainSettings {
            setting,
            known: Vec::new(),
            architecture,
            kind,
            init: None,
            open_set,
            cluster_scorer: is_full && setting == Setting::Udi,
            data,
            out,
            steps: 20_000,
            batch: 2,
            seed: 1,
            learning_rate: 0.003,
            prototype_scale: if is_full { 3.0 } else { classes },
            variance_weight: if is_open { 0.1 } else { 0.0 },
            bf16: false,
            augment: true,
            database_frames: if pastes { 1500 } else { 0 },
            validate_frames: 400,
            ignored_classes: Vec::new(),
            commit: "unknown".into(),
            checkpoint_every: 200,
        }
    }

    /// Checks ranges.
    pub fn check(&self) -> Result<(), TrainError> {
        let open_set = &self.open_set;
        let (center, unknown) = (open_set.center_loss_weight, open_set.unknown_weight);
        let pasted = open_set.synthetic_unknown as f32;
        let cells = open_set.background_cells as f32;
        let (steps, every) = (self.steps as f32, self.checkpoint_every as f32);
        // Option, value, the lowest and the highest allowed.
        let rows = [
            ("--steps", steps, 1.0, f32::MAX),
            ("--batch", self.batch as f32, 1.0, 64.0),
            ("--prototype-scale", self.prototype_scale, 0.1, 100.0),
            ("--variance-weight", self.variance_weight, 0.0, 100.0),
            ("--center-loss-weight", center, 0.0, 100.0),
            ("--unknown-weight", unknown, 0.0, 100.0),
            ("--synthetic-unknown", pasted, 0.0, 64.0),
            ("--background-cells", cells, 0.0, 4096.0),
            ("--checkpoint-every", every, 1.0, f32::MAX),
        ];
        for (name, value, low, high) in rows {
            if !(low..=high).contains(&value) {
                let expected = if high == f32::MAX {
                    format!("{low} or more")
                } else {
                    format!("{low} to {high}")
                };
                return Err(TrainError::setting(name, &expected, &value.to_string()));
            }
        }
        let (name, rate) = ("--learning-rate", self.learning_rate);
        if !(rate > 0.0 && rate < 1.0) {
            let found = rate.to_string();
            return Err(TrainError::setting(name, "above 0 and below 1", &found));
        }
        Ok(())
    }

    /// Classes that the network learns.
    pub fn classes(&self) -> usize {
        let unknown = if self.kind == NetworkKind::Supervised {
            self.setting.unknown_classes().len()
        } else {
            0
        };
        if self.known.is_empty() {
            return self.setting.classes() + unknown;
        }
        self.known.len()
    }

    /// The open-set settings that apply to this kind.
    pub fn applied_open_set(&self) -> OpenSetSettings {
        let asked = self.open_set.clone();
        match self.kind {
            NetworkKind::MlucFull => asked,
            NetworkKind::MetricOpen => OpenSetSettings {
                class_agnostic_anchors: false,
                ..asked
            },
            _ => OpenSetSettings {
                synthetic_unknown: 0,
                class_agnostic_anchors: false,
                background_cells: 0,
                ..OpenSetSettings::default()
            },
        }
    }

    /// The settings of the losses.
    pub fn losses(&self) -> LossSettings {
        let open_set = self.applied_open_set();
        let pushes = self.kind == NetworkKind::MetricOpen;
        let center_loss_weight = open_set.center_loss_weight;
        LossSettings {
            prototype_scale: self.prototype_scale(),
            variance_weight: self.variance_weight,
            center_loss_weight,
            push_weight: if pushes { center_loss_weight } else { 0.0 },
            unknown_weight: open_set.unknown_weight,
        }
    }

    /// The network to train.
    pub fn network(&self) -> Network {
        let is_agnostic = self.applied_open_set().class_agnostic_anchors;
        Network {
            head: self.kind.head(),
            generic: usize::from(is_agnostic) * Manifest::GENERIC_ANCHORS,
            ..self.setting.trunk(self.architecture, self.classes())
        }
    }

    /// Classes that labels may name: KITTI's and the simulator's, among them all that the network learns, and those to be ignored.
    pub fn accepted_classes(&self) -> Vec<String> {
        let heard = KITTI_CLASSES.iter().chain(&SIMULATED_CLASSES);
        let heard = heard.map(|name| (*name).to_owned());
        heard.chain(self.ignored_classes.iter().cloned()).collect()
    }

    /// The manifest before training: what the data decides is filled in later.
    pub fn manifest(&self) -> Manifest {
        let mut manifest = Manifest::untrained(self.setting.name(), self.network());
        manifest.classes.truncate(self.setting.classes());
        let like = manifest.classes[0].clone();
        let unknown = self.setting.unknown_classes().into_iter();
        let unknown = unknown.map(|(name, size_m)| AnchorClass {
            name: name.into(),
            size_m,
            matched_iou: 0.5,
            unmatched_iou: 0.35,
            ..like.clone()
        });
        let wanted = self.classes().saturating_sub(manifest.classes.len());
        manifest.classes.extend(unknown.take(wanted));
        if !self.known.is_empty() {
            manifest.classes = self
                .known
                .iter()
                .map(|name| AnchorClass::named(name))
                .collect();
        }
        Manifest {
            uses_intensity: false,
            prototype_scale: self.prototype_scale(),
            beams: match self.setting {
                // Any sensor's.
                Setting::Any => Beams::default(),
                _ => hdl_64e(),
            },
            takes: (self.setting == Setting::Any).then(any_sensor),
            ..manifest
        }
    }

    /// T: fixed where the head is one of logits.
    pub fn prototype_scale(&self) -> f32 {
        let fixed = self.kind.head().prototype_scale();
        fixed.unwrap_or(self.prototype_scale)
    }

    /// What a resumed run must share with its beginning, as text. The number of steps may change: the cycle then goes on
    /// from the same step, at the rate that the new number gives it.
    pub fn fingerprint(&self) -> String {
        let mut text = format!(
            "{} {:?} batch {} seed {} rate {} scale {} variance {} augment {} database {} bf16 {}",
            self.setting.name(),
            self.architecture,
            self.batch,
            self.seed,
            self.learning_rate,
            self.prototype_scale(),
            self.variance_weight,
            self.augment,
            self.database_frames,
            self.bf16
        );
        if self.kind != NetworkKind::Metric {
            text += &format!(" network {}", self.kind.name());
        }
        if self.kind.learns_from_synthetic_unknown() {
            let data = self.data.file_name().unwrap_or_default().display();
            text += &format!(" {:?} data {data}", self.open_set);
        }
        if !self.known.is_empty() {
            text += &format!(" known {}", self.known.join(","));
        }
        if let Some(init) = &self.init {
            text += &format!(" init {}", init.display());
        }
        text
    }
}

/// What the simulator draws for `sim-any`; the tilt, which it does not draw, is a guess.
fn any_sensor() -> Takes {
    Takes {
        beams: [6, 140],
        height_m: [0.3, 3.0],
        tilt_max_deg: 7.0,
        points: [2_000, 262_144],
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_setting_out_of_its_range_is_named() {
        let (data, out) = (PathBuf::new(), PathBuf::new());
        let kind = NetworkKind::MetricOpen;
        let good = TrainSettings::new(Setting::Kitti, Architecture::Compact, kind, data, out);
        assert!(good.check().is_ok());
        type Change = fn(&mut TrainSettings);
        let cases: [(Change, &str); 4] = [
            (|s| s.steps = 0, "--steps: expected 1 or more, found 0"),
            (|s| s.batch = 65, "--batch: expected 1 to 64, found 65"),
            (
                |s| s.learning_rate = 1.0,
                "--learning-rate: expected above 0 and below 1, found 1",
            ),
            (
                |s| s.open_set.center_loss_weight = f32::NAN,
                "--center-loss-weight: expected 0 to 100, found NaN",
            ),
        ];
        for (change, expected) in cases {
            let mut changed = good.clone();
            change(&mut changed);
            let fault = changed.check().expect_err("refused");
            assert_eq!(fault.to_string(), expected);
        }
    }
}
