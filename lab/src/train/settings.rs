//! What a training run can be told.

use std::path::PathBuf;

use mluc_model::{AnchorClass, Beams, Grid, HeadKind, Manifest, Network};
use serde::{Deserialize, Serialize};

use super::error::TrainError;
use crate::dataset::{KITTI_CLASSES, SIMULATED_CLASSES};

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

/// What is trained: a row, or several, of the paper's tables.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// The paper's metric head.
    #[default]
    Metric,
    /// The same, taught what the paper's loss leaves open: unknown objects are made up and drawn to the prototypes' centre, where EDS is
    /// least; background is drawn where it is large.
    MetricOpen,
    /// SECOND's own classifier: the closed set.
    Sigmoid,
    /// Objectness and a linear softmax: the naive baseline.
    Softmax,
    /// Ours: metric head, anchors without a class, made-up unknown objects.
    Improved,
    /// SECOND's classifier with the unknown classes labelled: the upper bound.
    Supervised,
    /// `Softmax` for a point embedding on its frozen trunk.
    Osis,
}

impl Kind {
    /// `metric` and so on.
    pub fn name(self) -> &'static str {
        match self {
            Kind::Metric => "metric",
            Kind::MetricOpen => "metric-open",
            Kind::Sigmoid => "sigmoid",
            Kind::Softmax => "softmax",
            Kind::Improved => "improved",
            Kind::Supervised => "supervised",
            Kind::Osis => "osis",
        }
    }

    /// Whether it learns the unknown from made-up objects.
    pub fn learns_from_made_up(self) -> bool {
        matches!(self, Kind::MetricOpen | Kind::Improved)
    }

    /// The head of its model file.
    pub fn head(self) -> HeadKind {
        match self {
            Kind::Metric | Kind::MetricOpen => HeadKind::Metric,
            Kind::Softmax | Kind::Osis => HeadKind::Softmax,
            Kind::Improved => HeadKind::Open,
            Kind::Sigmoid | Kind::Supervised => HeadKind::Sigmoid,
        }
    }
}

/// Cells of background that `metric-open` learns from: many, so that some look like an object. A guess.
const METRIC_OPEN_BACKGROUND_CELLS: usize = 512;

/// What [`Kind::Improved`] and in part [`Kind::MetricOpen`] add, each to be left out for an ablation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Improvements {
    /// Made-up unknown objects pasted into a frame, at most; those that the data itself holds come on top.
    pub made_up: usize,
    /// Weight of the loss that draws their embeddings to the prototypes' centre, and of [`Kind::MetricOpen`] those of background away.
    pub pull_weight: f32,
    /// Weight of the logit of the unknown; of [`Kind::Improved`] alone.
    pub unknown_weight: f32,
    /// Anchors without a class; of [`Kind::Improved`] alone.
    pub generic_anchors: bool,
    /// Cells of a frame that hold points and no object, and are learned from as background.
    pub background_cells: usize,
}

impl Default for Improvements {
    /// Guesses, to be measured one by one.
    fn default() -> Improvements {
        Improvements {
            made_up: 6,
            pull_weight: 0.5,
            unknown_weight: 1.0,
            generic_anchors: true,
            background_cells: 64,
        }
    }
}

/// A training run. What changes the weights is compared when a run is resumed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// Classes and range.
    pub setting: Setting,
    /// Network.
    pub profile: Profile,
    /// What its heads learn.
    pub kind: Kind,
    /// A model file, or the folder of a run, whose weights are taken where they fit.
    pub init: Option<PathBuf>,
    /// Of kinds that [learn from made-up objects](Kind::learns_from_made_up) alone.
    pub improvements: Improvements,
    /// Of [`Kind::Improved`] alone: fit layers that tell objects from walls and leaves by the looks of their clusters. On by default for
    /// UDI. No known class of KITTI's is as large as a truck, so that the layers take trucks for walls.
    pub looks: bool,
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

    /// The unknown classes, which only the upper bound learns: name, and a size (l, w, h, m) until the data gives one.
    pub fn unknown_classes(self) -> [(&'static str, [f32; 3]); 2] {
        match self {
            Setting::Udi => [
                ("golf_cart", [2.4, 1.25, 1.85]),
                ("forklift", [3.0, 1.2, 2.1]),
            ],
            Setting::Kitti => [("van", [5.1, 1.9, 2.2]), ("truck", [10.0, 2.6, 3.2])],
        }
    }
}

impl Settings {
    /// What a run does unless it is told otherwise.
    pub fn new(
        setting: Setting,
        profile: Profile,
        kind: Kind,
        data: PathBuf,
        out: PathBuf,
    ) -> Settings {
        let improved = kind == Kind::Improved;
        Settings {
            setting,
            profile,
            kind,
            init: None,
            improvements: Improvements {
                background_cells: match kind {
                    Kind::MetricOpen => METRIC_OPEN_BACKGROUND_CELLS,
                    _ => Improvements::default().background_cells,
                },
                ..Improvements::default()
            },
            looks: improved && setting == Setting::Udi,
            data,
            out,
            steps: 20_000,
            batch: 2,
            seed: 1,
            learning_rate: 0.003,
            prototype_scale: if improved {
                3.0
            } else {
                setting.classes() as f32
            },
            variance_weight: if kind.learns_from_made_up() { 0.1 } else { 0.0 },
            bf16: false,
            augment: true,
            database_frames: 1500,
            validate_frames: 400,
            ignored_classes: Vec::new(),
            commit: "unknown".into(),
            checkpoint_every: 200,
        }
    }

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
            () if !(0.0..=100.0).contains(&self.improvements.pull_weight) => wrong(
                "--pull-weight",
                "0 to 100",
                self.improvements.pull_weight.to_string(),
            ),
            () if !(0.0..=100.0).contains(&self.improvements.unknown_weight) => wrong(
                "--unknown-weight",
                "0 to 100",
                self.improvements.unknown_weight.to_string(),
            ),
            () if self.improvements.made_up > 64 => wrong(
                "--made-up",
                "0 to 64",
                self.improvements.made_up.to_string(),
            ),
            () if self.improvements.background_cells > 4096 => wrong(
                "--background-cells",
                "0 to 4096",
                self.improvements.background_cells.to_string(),
            ),
            () if self.checkpoint_every == 0 => {
                wrong("--checkpoint-every", "1 or more", "0".into())
            }
            () => Ok(()),
        }
    }

    /// Classes that the network learns.
    pub fn classes(&self) -> usize {
        let unknown = self.setting.unknown_classes().len();
        self.setting.classes()
            + if self.kind == Kind::Supervised {
                unknown
            } else {
                0
            }
    }

    /// Objects of each class that a frame holds after pasting (paper's implementation for KITTI; a choice for UDI and for
    /// the unknown classes).
    pub fn objects_wanted(&self) -> Vec<usize> {
        let wanted = match self.setting {
            Setting::Udi => [8, 10, 10, 5, 5, 5].as_slice(),
            Setting::Kitti => &[15, 10, 10, 5, 5],
        };
        wanted[..self.classes()].to_vec()
    }

    /// The improvements that apply.
    pub fn improvements(&self) -> Improvements {
        match self.kind {
            Kind::Improved => self.improvements.clone(),
            Kind::MetricOpen => Improvements {
                generic_anchors: false,
                ..self.improvements.clone()
            },
            _ => Improvements {
                made_up: 0,
                generic_anchors: false,
                background_cells: 0,
                ..Improvements::default()
            },
        }
    }

    /// The network to train.
    pub fn network(&self) -> Network {
        let generic = if self.improvements().generic_anchors {
            Manifest::GENERIC_ANCHORS
        } else {
            0
        };
        Network {
            head: self.kind.head(),
            generic,
            ..self.trunk(self.classes())
        }
    }

    fn trunk(&self, classes: usize) -> Network {
        match (self.profile, self.setting) {
            (Profile::Compact, Setting::Udi) => {
                Network::compact(Grid::udi(), classes).with_reach_of_trucks()
            }
            (Profile::Compact, Setting::Kitti) => Network::compact(Grid::kitti_compact(), classes),
            (Profile::Second, Setting::Udi) => Network::second(Grid::udi(), classes),
            (Profile::Second, Setting::Kitti) => Network::second(Grid::kitti_second(), classes),
        }
    }

    /// Classes that labels may name: KITTI's and the simulator's, among them all that the network learns, and those to be ignored.
    pub fn heard_classes(&self) -> Vec<String> {
        let heard = KITTI_CLASSES.iter().chain(&SIMULATED_CLASSES);
        let heard = heard.map(|name| (*name).to_owned());
        heard.chain(self.ignored_classes.iter().cloned()).collect()
    }

    /// The manifest before training: what the data decides is filled in later.
    pub fn manifest(&self) -> Manifest {
        let mut manifest = Manifest::untrained(self.setting.name(), self.network());
        manifest.classes.truncate(self.setting.classes());
        let like = manifest.classes[0].clone();
        let unknown = self
            .setting
            .unknown_classes()
            .map(|(name, size_m)| AnchorClass {
                name: name.into(),
                size_m,
                matched_iou: 0.5,
                unmatched_iou: 0.35,
                ..like.clone()
            });
        let wanted = self.classes() - manifest.classes.len();
        manifest.classes.extend(unknown.into_iter().take(wanted));
        Manifest {
            uses_intensity: false,
            prototype_scale: self.prototype_scale(),
            beams: hdl_64e(),
            ..manifest
        }
    }

    /// T: fixed where the head is one of logits.
    pub fn prototype_scale(&self) -> f32 {
        self.kind
            .head()
            .prototype_scale()
            .unwrap_or(self.prototype_scale)
    }

    /// What a resumed run must share with its beginning, as text. The number of steps may change: the cycle then goes on
    /// from the same step, at the rate that the new number gives it.
    pub fn fingerprint(&self) -> String {
        let mut text = format!(
            "{} {:?} batch {} seed {} rate {} scale {} variance {} augment {} database {} bf16 {}",
            self.setting.name(),
            self.profile,
            self.batch,
            self.seed,
            self.learning_rate,
            self.prototype_scale(),
            self.variance_weight,
            self.augment,
            self.database_frames,
            self.bf16
        );
        if self.kind != Kind::Metric {
            text += &format!(" network {}", self.kind.name());
        }
        if self.kind.learns_from_made_up() {
            let data = self.data.file_name().unwrap_or_default().display();
            text += &format!(" {:?} data {data}", self.improvements);
        }
        if let Some(init) = &self.init {
            text += &format!(" init {}", init.display());
        }
        text
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
