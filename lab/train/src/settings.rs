//! The settings of a training run.

use crate::kind::{Architecture, NetworkKind, Setting};
use crate::losses::LossSettings;
use clap::{Parser, builder::RangedU64ValueParser};
use mluc_dataset::{KITTI_CLASSES, SIMULATED_CLASSES};
use mluc_evaluate::pipeline::{folder_tail, unknown_classes};
use mluc_kernels::Level;
use mluc_model::{AnchorClass, Beams, Manifest, Network, Takes};
use std::{convert::Infallible, path::Path, path::PathBuf};

fn learning_rate(text: &str) -> Result<f64, String> {
    let rate = text.parse().ok().filter(|rate| *rate > 0.0 && *rate < 1.0);
    rate.ok_or_else(|| format!("expected above 0 and below 1, found {text}"))
}

/// A training run. What changes the weights is compared when a run is resumed; not --steps: the learning
/// rate then follows the new cycle from there on.
#[derive(Clone, Debug, PartialEq, Parser)]
pub struct TrainSettings {
    /// Classes and range.
    #[arg(long, value_enum)]
    pub setting: Setting,
    /// Classes to learn, of those that the labels name [default: the setting's].
    #[arg(long, value_delimiter = ',', value_name = "CLASS,..", value_parser = |name: &str| Ok::<_, Infallible>(name.to_ascii_lowercase()))]
    pub known: Vec<String>,
    /// Size of the network.
    #[arg(long, value_enum, default_value = "compact")]
    pub architecture: Architecture,
    /// What its heads learn.
    #[arg(long = "network", value_name = "NETWORK")]
    #[arg(value_enum, default_value = "metric")]
    pub kind: NetworkKind,
    /// Folder with train/ and val/ in KITTI's format (`mluc-lab simulate` makes them); all scans in them are taken, lists in ImageSets are not read.
    #[arg(long)]
    pub data: PathBuf,
    /// Folder of the run: log, checkpoint, model.safetensors.
    #[arg(long)]
    pub out: PathBuf,
    /// Start from the weights of this model file (or run's folder) where they fit.
    #[arg(long)]
    pub init: Option<PathBuf>,
    /// Optimiser steps.
    #[arg(long, default_value_t = 20_000, value_parser = clap::value_parser!(u64).range(1..))]
    pub steps: u64,
    /// Frames per step.
    #[arg(long, default_value_t = 2, value_parser = RangedU64ValueParser::<usize>::new().range(1..=64))]
    pub batch: usize,
    /// Seed of weights, order and augmentation.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Highest learning rate of the cycle.
    #[arg(long, default_value_t = 0.003, value_parser = learning_rate)]
    pub learning_rate: f64,
    /// Multiply in bf16 except in the heads, with sums in f32: faster where the processor has bf16.
    #[arg(long)]
    pub bf16: bool,
    /// Frames of val/ that judge the model after every epoch and at the end; 0: none.
    #[arg(long, default_value_t = 400)]
    pub validate_frames: usize,
    /// Classes of labels that the network does not know, in addition to KITTI's and the simulator's; nothing is learned at their places. Any other class is
    /// an error, because a misspelt class would be left out unnoticed. Cars, pedestrians and cyclists that it does not know are trained as unknown objects.
    #[arg(long = "ignore-classes", value_name = "CLASS,..")]
    #[arg(value_delimiter = ',')]
    pub ignored_classes: Vec<String>,
    /// Steps between checkpoints.
    #[arg(long, default_value_t = 200, value_parser = clap::value_parser!(u64).range(1..))]
    pub checkpoint_every: u64,
    /// Commit of the trainer, for the model file.
    #[arg(skip = "unknown")]
    pub commit: String,
}

impl TrainSettings {
    /// The settings that `mluc-lab train` makes of these options.
    ///
    /// # Panics
    /// If an option is not valid.
    pub fn of(options: &[&str], data: &Path, out: &Path) -> TrainSettings {
        let options = ["train", "--data=.", "--out=."].iter().chain(options);
        let mut settings = TrainSettings::try_parse_from(options).expect("options of the trainer");
        (settings.data, settings.out) = (data.into(), out.into());
        settings
    }

    /// Whether this processor multiplies bf16 in hardware; on others f32 is faster.
    pub fn bf16_is_faster() -> bool {
        Level::best().name() == "avx512bf16"
    }

    /// Number of classes that the network learns.
    pub fn classes(&self) -> usize {
        if !self.known.is_empty() {
            return self.known.len();
        }
        let is_supervised = self.kind == NetworkKind::Supervised;
        let unknown = unknown_classes(self.setting.name()).len();
        self.setting.classes() + usize::from(is_supervised) * unknown
    }

    /// Number of synthetic unknown objects pasted into a frame, in addition to those in the data (simulate --synthetic-unknown).
    pub fn synthetic_unknown(&self) -> usize {
        // A guess. An object from one sensor's scan does not fit the scan of another sensor.
        let pastes = self.kind.learns_from_synthetic_unknown() && self.setting != Setting::Any;
        6 * usize::from(pastes)
    }

    /// Number of frames of the training split that supply objects to paste.
    pub fn database_frames(&self) -> usize {
        let pastes = self.setting != Setting::Any;
        1500 * usize::from(pastes)
    }

    /// Background cells per frame (points, no object) in the loss. Many for metric-open, so that some resemble an object; both numbers are guesses.
    pub fn background_cells(&self) -> usize {
        match self.kind {
            NetworkKind::MlucFull => 64,
            NetworkKind::MetricOpen => 512,
            _ => 0,
        }
    }

    /// The settings of the losses; the values for the unknown are guesses.
    pub fn losses(&self) -> LossSettings {
        let draws = self.kind.learns_from_synthetic_unknown();
        let pushes = self.kind == NetworkKind::MetricOpen;
        LossSettings {
            prototype_scale: self.prototype_scale(),
            variance_weight: if draws { 0.1 } else { 0.0 },
            push_weight: if pushes { 0.5 } else { 0.0 },
        }
    }

    /// The network to train.
    pub fn network(&self) -> Network {
        let is_agnostic = self.kind == NetworkKind::MlucFull;
        Network {
            head: self.kind.head(),
            generic: usize::from(is_agnostic) * Manifest::GENERIC_ANCHORS,
            ..self.setting.trunk(self.architecture, self.classes())
        }
    }

    /// Classes that labels may name: KITTI's and the simulator's, all classes that the network learns, and the ignored ones.
    pub fn accepted_classes(&self) -> Vec<String> {
        let heard = KITTI_CLASSES.iter().chain(&SIMULATED_CLASSES).map(|name| (*name).to_owned());
        let own = self.ignored_classes.iter().chain(&self.known);
        heard.chain(own.cloned()).collect()
    }

    /// The manifest before training: values from the data are filled in later.
    pub fn manifest(&self) -> Manifest {
        let mut manifest = Manifest::untrained(self.setting.name(), self.network());
        manifest.classes.truncate(self.setting.classes());
        let like = manifest.classes[0].clone();
        let unknown = unknown_classes(self.setting.name()).into_iter();
        let unknown = unknown.map(|name| AnchorClass {
            name,
            matched_iou: 0.5,
            unmatched_iou: 0.35,
            ..like.clone()
        });
        let wanted = self.classes().saturating_sub(manifest.classes.len());
        manifest.classes.extend(unknown.take(wanted));
        if !self.known.is_empty() {
            let named = self.known.iter().map(|name| AnchorClass::named(name));
            manifest.classes = named.collect();
        }
        if self.kind == NetworkKind::MlucFull {
            // Boxes of people side by side overlap a little.
            manifest.thresholds.nms_iou = 0.2;
            // More likely unknown than known.
            manifest.thresholds.unknown_min = 0.5;
        }
        let person = manifest.generic.first_mut();
        if let Some(person) = person.filter(|_| self.setting == Setting::Any) {
            // With these a fallen person has three anchors, not one.
            (person.matched_iou, person.unmatched_iou) = (0.35, 0.2);
        }
        Manifest {
            uses_intensity: false,
            prototype_scale: self.prototype_scale(),
            beams: match self.setting {
                // Beams of any sensor.
                Setting::Any => Beams::default(),
                _ => hdl_64e(),
            },
            // The ranges that the simulator draws for `sim-any`; it draws slopes of at most 3 degrees, so the tilt is a guess.
            takes: (self.setting == Setting::Any).then_some(Takes {
                beams: [6, 140],
                height_m: [0.3, 3.0],
                tilt_max_deg: 7.0,
                points: [2_000, 262_144],
            }),
            ..manifest
        }
    }

    /// T, the length of the prototypes: fixed for a head of logits, else the number of classes (paper section 3.2), or 3 for mluc-full.
    pub fn prototype_scale(&self) -> f32 {
        let fixed = self.kind.head().prototype_scale();
        fixed.unwrap_or(match self.kind {
            NetworkKind::MlucFull => 3.0,
            _ => self.classes() as f32,
        })
    }

    /// The settings that a resumed run must share with its start, as text. The number of steps may change: the cycle then continues
    /// from the same step, at the rate of the new number.
    pub fn fingerprint(&self) -> String {
        let whole = |path: &PathBuf| path.canonicalize().unwrap_or(path.clone());
        // It may be given relative to another folder.
        let init = self.init.as_ref();
        let init = init.map(|path| folder_tail(&whole(path)).into());
        let shared = TrainSettings {
            steps: 0,
            validate_frames: 0,
            checkpoint_every: 0,
            data: PathBuf::new(),
            out: PathBuf::new(),
            commit: String::new(),
            init,
            ..self.clone()
        };
        format!("{shared:?}")
    }
}

/// The beams of a Velodyne HDL-64E (nominal values of public calibrations, as in the simulator; real sensors differ by
/// about 0.1 deg), from the top down, and the step between columns at 10 Hz.
fn hdl_64e() -> Beams {
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
        // A folder's name may start like an option.
        let (data, out) = (Path::new("data"), Path::new("-out"));
        let good = ["--setting", "kitti", "--network", "metric-open"];
        let losses = TrainSettings::of(&good, data, out).losses();
        assert_eq!(losses.variance_weight, 0.1);
        let two = ["--setting", "kitti", "--known", "car,van"];
        let two = TrainSettings::of(&two, data, out);
        assert_eq!(two.prototype_scale(), 2.0);
        for (option, value) in [("steps", "0"), ("batch", "65"), ("learning-rate", "1")] {
            let option = format!("--{option}={value}");
            let options = ["train", "--setting=kitti", "--data=d", "--out=o", &option];
            let fault = TrainSettings::try_parse_from(options).expect_err("refused");
            let named = format!("invalid value '{value}' for '{}", &option[..5]);
            assert!(fault.to_string().contains(&named), "{fault}");
        }
    }

    #[test]
    fn a_new_model_for_any_sensor_has_gate_and_overlap_of_the_shipped_one() {
        let options = ["--setting", "any", "--network", "mluc-full"];
        let new = TrainSettings::of(&options, Path::new("data"), Path::new("out")).manifest();
        let weights = concat!(env!("CARGO_MANIFEST_DIR"), "/../../weights");
        let shipped = Path::new(weights).join("any-open.safetensors");
        let shipped = mluc_model::Model::read(&shipped).expect("a model").manifest;
        assert_eq!(new.thresholds.nms_iou, shipped.thresholds.nms_iou);
        assert_eq!(new.thresholds.unknown_min, shipped.thresholds.unknown_min);
        assert_eq!(new.network.grid, shipped.network.grid);
    }
}
