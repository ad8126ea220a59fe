//! The settings of the tables, and the size of a reproduction.

use mluc_simulate::Family;
use serde::Deserialize;
use std::collections::BTreeMap;

/// What the tables are made on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, clap::ValueEnum)]
pub(crate) enum Setting {
    /// Simulated industrial park, all around: knowns car, pedestrian, cyclist, truck; unknown golf cart, forklift.
    #[value(name = "udi")]
    SimUdi,
    /// Simulated streets, ahead: knowns car, pedestrian, cyclist; unknown van, truck.
    #[value(name = "kitti")]
    SimKitti,
    /// KITTI's object benchmark, where a user has it; classes as `SimKitti`.
    #[value(skip)]
    Kitti,
}

impl Setting {
    /// Key in `report.json`, and name of its folders.
    pub(crate) fn name(self) -> &'static str {
        ["sim-udi", "sim-kitti", "kitti"][self as usize]
    }

    /// The trainer's name for its classes and range.
    pub(crate) fn trainer_name(self) -> &'static str {
        ["udi", "kitti", "kitti"][self as usize]
    }

    /// The simulator's family; `None` for recorded scans.
    pub(crate) fn family(self) -> Option<Family> {
        [Some(Family::SimUdi), Some(Family::SimKitti), None][self as usize]
    }
}

/// Frames and steps of a plan, for one setting.
#[derive(Clone, Copy, Debug, Deserialize)]
pub(crate) struct Sizes {
    /// Training scans with known classes only; the same number with synthetic unknown objects.
    pub(crate) train_frames: u32,
    /// Training scans of the supervised network, with labelled unknown classes.
    pub(crate) supervised_frames: u32,
    /// Validation scans, for the trainer's own evaluation of a network.
    pub(crate) val_frames: u32,
    /// Test scans, for every figure of the report.
    pub(crate) test_frames: u32,
    /// Steps of the base network (`metric`).
    pub(crate) base_steps: u64,
    /// Steps of each network that starts from the base's weights.
    pub(crate) tuned_steps: u64,
    /// Steps of the networks that learn new outputs, new classes, or the location of unknown objects (`metric-open`, our own, `supervised`),
    /// and of the closed set for comparison. On streets these steps raise the AP of the unknown of our own by 13 points on validation scans.
    pub(crate) longer_steps: u64,
    pub(crate) batch: u32,
    /// Number of validation scans that the trainer evaluates on.
    pub(crate) validate_frames: u32,
    pub(crate) resamples: usize,
}

impl Sizes {
    /// From the table in `sizes.json`, which the documentation quotes.
    pub(crate) fn of(size: &str, setting: Setting) -> Sizes {
        let table = include_str!("sizes.json");
        let table: BTreeMap<String, BTreeMap<String, Sizes>> =
            serde_json::from_str(table).expect("the table of sizes");
        table[size][setting.trainer_name()]
    }
}
