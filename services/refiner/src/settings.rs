//! What a user sets of the refiner, with units; every default says where its number comes from.
//!
//! What is known of vehicles stands in `priors.rs`, and what only a study turns is [`Study`].

use mluc_model::ScoreMin;
use serde::{Deserialize, Serialize};
use smart_default::SmartDefault;
use std::fmt::Display;

/// Settings, a model or a sensor that no refiner can work with: what it is about, what is expected, what was found.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{0}")]
pub struct RefinerError(String);

impl RefinerError {
    pub(crate) fn new(what: impl Display, expected: impl Display, found: impl Display) -> Self {
        RefinerError(format!("{what}: expected {expected}, found {found}"))
    }

    /// The first setting that is out of its range: name, what is expected, value, whether that fits.
    pub(crate) fn unless_all<const COUNT: usize>(
        rules: [(&str, &str, f64, bool); COUNT],
    ) -> Result<(), RefinerError> {
        match rules.into_iter().find(|(.., fits)| !fits) {
            Some((name, expected, found, _)) => {
                let what = format_args!("refiner setting {name}");
                Err(RefinerError::new(what, expected, found))
            }
            None => Ok(()),
        }
    }
}

/// How the points of an unknown object are found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Variant {
    /// The paper's algorithm 1 as printed.
    Paper,
    /// Algorithm 1 with the inequality of the original depth clustering, ground removed, and an oriented box.
    PaperCorrected,
    /// The scan is clustered once, with a join distance that grows with range, and proposals are matched to clusters.
    #[default]
    RangeScaled,
    /// The proposal's box as it is.
    None,
}

mluc_ipc_types::values!(Variant: Paper "paper" PaperCorrected "paper-corrected" RangeScaled "range-scaled" None "none");

/// What a user sets. Join distance: `join_m` + `join_per_range` x range, at most `join_max_m`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, SmartDefault)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// How an unknown object's points are found: `paper`, `paper-corrected`, `range-scaled` or `none`.
    pub variant: Variant,
    /// Time that a frame may take where the sensor sets the pace, ms, above 0 to 10,000. Candidates that are left keep their
    /// proposal box, counted and flagged. Three tenths of a 10 Hz sensor's period: ordinary frames stay far below it.
    #[default(30.0)]
    pub time_max_ms: f64,
    /// Fewer points make no cluster, 1 to 10,000. (`paper` has no such rule.)
    #[default(8)]
    pub points_min: u32,
    /// Points lower than this above the ground belong to it, m, above 0 to 100. 0.1 to 0.2 measure alike on simulated scans.
    #[default(0.15)]
    pub ground_clearance_m: f64,
    /// Points higher than this above the ground hang over the road, m, above 0 to 100: branches, bridges, signs.
    #[default(4.5)]
    pub height_max_m: f64,
    /// Join distance at the sensor, m, above 0 to 3.5. Tuned on simulated validation scans, as the next two.
    #[default(0.4)]
    pub join_m: f64,
    /// Join distance, m per m of range, 0 to 1, for the rays of an HDL-64E: the gap between them grows with range. Other rays scale it.
    #[default(0.0175)]
    pub join_per_range: f64,
    /// Longest join distance, m, above 0 to 3.5.
    #[default(1.2)]
    pub join_max_m: f64,
    /// What the robot may drive over; in a file `[robot]`, a table of its own.
    #[serde(skip)]
    pub robot: RobotSettings,
    /// What is published; in no file: the program has it from its operating profile.
    #[serde(skip)]
    pub score_min: ScoreMin,
    /// What a study turns; in no file.
    #[serde(skip)]
    pub study: Study,
}

/// Unknown objects that the robot's owner does not want published: they stay in the output as `undersized`. Off by default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RobotSettings {
    /// The robot drives over what is lower than this, m, 0 to 100. 0: nothing is left out.
    pub height_min_m: f64,
    /// What is narrower than this is no obstacle to the robot, m, 0 to 100. 0: nothing is left out.
    pub width_min_m: f64,
}

/// What studies turn to measure what each step is worth. `None`: as the variant and the model have it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Study {
    /// Whether the score of the cluster ([`crate::ClusterScorer`]) ranks.
    pub scores_clusters: Option<bool>,
    /// Whether objects of no road user's size are ranked last.
    pub ranks_sizes: Option<bool>,
}

impl Settings {
    /// The defaults with this variant.
    pub fn of(variant: Variant) -> Settings {
        Settings { variant, ..Settings::default() }
    }

    /// Refuses what makes no sense, by name.
    pub fn check(&self) -> Result<(), RefinerError> {
        const ABOVE_0: &str = "a length above 0 and at most 100 m";
        const FROM_0: &str = "a length of 0 to 100 m";
        let above_0 = |name, v: f64| (name, ABOVE_0, v, v > 0.0 && v <= 100.0);
        let from_0 = |name, v: f64| (name, FROM_0, v, (0.0..=100.0).contains(&v));
        let within = |name, expected, v: f64, most| (name, expected, v, v > 0.0 && v <= most);
        let share = self.join_per_range;
        let is_share = (0.0..=1.0).contains(&share);
        let points_min = self.points_min.into();
        let (high, is_far) = (self.height_max_m, self.join_max_m >= self.join_m);
        let is_high = high > self.ground_clearance_m;
        let rules = [
            within("time_max_ms", "above 0 to 10,000 ms", self.time_max_ms, 1e4),
            within("points_min", "1 to 10,000 points", points_min, 1e4),
            above_0("ground_clearance_m", self.ground_clearance_m),
            above_0("height_max_m", self.height_max_m),
            within("join_m", "above 0 to 3.5 m", self.join_m, 3.5),
            ("join_per_range", "a share of 0 to 1", share, is_share),
            within("join_max_m", "above 0 to 3.5 m", self.join_max_m, 3.5),
            from_0("robot.height_min_m", self.robot.height_min_m),
            from_0("robot.width_min_m", self.robot.width_min_m),
            ("height_max_m", "above ground_clearance_m", high, is_high),
            ("join_max_m", "join_m or more", self.join_max_m, is_far),
        ];
        RefinerError::unless_all(rules)
    }

    /// Whether unknown objects have a score of our own, not the paper's.
    pub(crate) fn is_ours(&self) -> bool {
        self.variant == Variant::RangeScaled
    }
}
