//! Contents of a report, as in `report.json`.
//!
//! ```json
//! {"sim-udi": {"paper-corrected": {"map_known": [mean, spread], "ap_unknown": [..], "map_harm": [..], ..}, ..},
//!  "details": {"sim-udi": {"unknown_labels", "known_labels", "data": [..], "networks": [..], "ablation": [..], "real": [..]}, ..},
//!  "provenance": {..}}
//! ```
//!
//! Figures are in percent unless their name says otherwise; AP is for 3D boxes, moderate, at 40 recall positions unless the name ends in
//! `_r11` or `_all`. Label numbers are of the labels that count, by class.

use crate::methods::{METHODS, MethodRow};
use mluc_evaluate::SweepPoint;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;

pub(crate) type MeanSpread = [f64; 2];

/// The variation behind a standard deviation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum SpreadKind {
    /// Resamples of the test frames, one network.
    #[default]
    Bootstrap,
    /// Networks of several seeds, on the same test frames.
    Seeds,
}

/// A row of the tables.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub(crate) struct MethodFigures {
    pub(crate) network: String,
    pub(crate) spread: SpreadKind,
    pub(crate) seeds: Vec<u64>,
    /// Threshold of the row for each seed: best harmonic mean on the test frames (the paper's choice, an oracle).
    pub(crate) thresholds: Vec<f64>,
    /// AP of each known class.
    pub(crate) classes: BTreeMap<String, MeanSpread>,
    /// The same figures with thresholds chosen on the other half of the test frames: mean, and spread over seeds (0 with one).
    pub(crate) honest: BTreeMap<String, MeanSpread>,
    /// The sweep of the first seed: the points that keep nine tenths of the closed set's mAP.
    pub(crate) curve: Vec<SweepPoint>,
    /// `map_known`, `ap_unknown`, `map_harm`, `recall_unknown` and related figures at the chosen threshold.
    #[serde(flatten)]
    pub(crate) figures: BTreeMap<String, MeanSpread>,
}

/// The rows of a setting by key.
pub(crate) type Rows = BTreeMap<String, MethodFigures>;

/// The rows of a report, in the order of the tables.
pub(super) fn present(rows: &Rows) -> impl Iterator<Item = (&'static MethodRow, &MethodFigures)> {
    METHODS.iter().filter_map(|row| Some((row, rows.get(&row.key)?)))
}

impl MethodFigures {
    /// The mean of a figure; `None` where it is missing.
    pub(crate) fn mean(&self, name: &str) -> Option<f64> {
        Some(self.figures.get(name)?[0])
    }
}

#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct ReproductionReport {
    pub(crate) details: BTreeMap<String, Value>,
    pub(crate) provenance: Value,
    /// Rows by setting (`sim-udi`, `sim-kitti`, `kitti`), then by method.
    #[serde(flatten)]
    pub(crate) settings: BTreeMap<String, Rows>,
}
