//! What a report holds, as it lies in `report.json`.
//!
//! ```json
//! {"sim-udi": {"paper-corrected": {"map_known": [mean, spread], "ap_unknown": [..], "map_harm": [..], ..}, ..},
//!  "details": {"sim-udi": {..}}, "provenance": {..}}
//! ```
//!
//! Figures are percent unless their name says otherwise; AP is of volumes, moderate, at 40 recall positions unless the name ends in
//! `_r11` or `_all`.

use crate::methods::{METHODS, MethodRow};
use mluc_evaluate::SweepPoint;
use mluc_evaluate::pipeline::ScoreSeparation;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

pub(crate) type MeanSpread = [f64; 2];

/// What a standard deviation is over.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum SpreadKind {
    /// Draws of the test frames, one network.
    #[default]
    Bootstrap,
    /// Networks of several seeds, the same test frames.
    Seeds,
}

/// A row of the tables.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub(crate) struct MethodFigures {
    pub(crate) network: String,
    pub(crate) spread: SpreadKind,
    pub(crate) seeds: Vec<u64>,
    /// Threshold that each seed's row stands at: best harmonic mean on the test frames (the paper's choice, an oracle).
    pub(crate) thresholds: Vec<f64>,
    /// AP of each known class.
    pub(crate) classes: BTreeMap<String, MeanSpread>,
    /// The same figures with thresholds chosen on the other half of the test frames: mean, and spread over seeds (0 with one).
    pub(crate) honest: BTreeMap<String, MeanSpread>,
    /// The sweep of the first seed, those points that keep nine tenths of the closed set's mAP.
    pub(crate) curve: Vec<SweepPoint>,
    /// `map_known`, `ap_unknown`, `map_harm`, `recall_unknown` and their companions at the chosen threshold.
    #[serde(flatten)]
    pub(crate) figures: BTreeMap<String, MeanSpread>,
}

/// The rows of a setting by key.
pub(crate) type Rows = BTreeMap<String, MethodFigures>;

/// The rows that a report has, in the order of the tables.
pub(super) fn present(rows: &Rows) -> impl Iterator<Item = (&'static MethodRow, &MethodFigures)> {
    let all = METHODS.iter();
    all.filter_map(|row| Some((row, rows.get(&row.key)?)))
}

impl MethodFigures {
    /// The mean of a figure; `None` where it was not taken.
    pub(crate) fn mean(&self, name: &str) -> Option<f64> {
        Some(self.figures.get(name)?[0])
    }
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct NetworkDetails {
    pub(crate) network: String,
    pub(crate) seed: u64,
    pub(crate) steps: u64,
    pub(crate) batch: u32,
    /// The command that trained it; "given" where the network lay in the runs' folder already.
    pub(crate) command: String,
    pub(crate) commit: String,
    pub(crate) fingerprint: String,
    pub(crate) separation: Vec<ScoreSeparation>,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct DataOrigin {
    /// Part of it: train, supervised, val, test.
    pub(crate) split: String,
    pub(crate) frames: usize,
    pub(crate) command: String,
    /// FNV-1a over all labels, the sizes of all scans and the bytes of every 50th scan, in order.
    pub(crate) hash: String,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct AblationRow {
    pub(crate) step: String,
    pub(crate) figures: MethodFigures,
}

/// A method on recorded scans, its network trained on simulated ones alone.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct RealRow {
    pub(crate) method: String,
    pub(crate) data: String,
    pub(crate) frames: usize,
    /// Threshold, chosen on simulated scans.
    pub(crate) threshold: f64,
    /// AP over all points, moderate, by class; `unknown` at overlap 0.1, cars at 0.5.
    pub(crate) ap_all: BTreeMap<String, f64>,
    /// AP of `unknown` where trams, Misc, sitting persons and what lies in DontCare regions are neither right nor wrong.
    pub(crate) ap_unknown_fair: Option<f64>,
    /// Labels that count, by class.
    pub(crate) labels: BTreeMap<String, usize>,
    pub(crate) recall_unknown: f64,
}

/// What belongs to a setting and to no single row.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Details {
    pub(crate) data: Vec<DataOrigin>,
    pub(crate) networks: Vec<NetworkDetails>,
    /// Unknown labels that count on the test frames.
    pub(crate) unknown_labels: usize,
    /// Known labels that count, by class.
    pub(crate) known_labels: BTreeMap<String, usize>,
    #[serde(default)]
    pub(crate) ablation: Vec<AblationRow>,
    #[serde(default)]
    pub(crate) real: Vec<RealRow>,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Provenance {
    pub(crate) commit: String,
    pub(crate) command: String,
    /// Size of the plan: full or quick.
    pub(crate) size: String,
    /// Draws of the bootstrap and their seed.
    pub(crate) bootstrap: [u64; 2],
    pub(crate) threads: usize,
    /// How networks come to be, in words.
    pub(crate) training: String,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct ReproductionReport {
    pub(crate) details: BTreeMap<String, Details>,
    pub(crate) provenance: Provenance,
    /// By setting (`sim-udi`, `sim-kitti`, `kitti`), then by method.
    #[serde(flatten)]
    pub(crate) settings: BTreeMap<String, Rows>,
}
