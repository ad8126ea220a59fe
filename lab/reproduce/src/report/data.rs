//! What a report holds, as it lies in `report.json`.
//!
//! ```json
//! {"sim-udi": {"paper-corrected": {"map_known": [mean, spread], "ap_unknown": [..], "map_harm": [..], ..}, ..},
//!  "details": {"sim-udi": {..}}, "provenance": {..}}
//! ```
//!
//! Figures are percent unless their name says otherwise; AP is of volumes, moderate, at 40 recall positions unless the name ends in
//! `_r11` or `_all`.

use mluc_evaluate::SweepPoint;
use mluc_evaluate::pipeline::ScoreSeparation;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Mean and spread of a figure.
pub type MeanSpread = [f64; 2];

/// What a spread is of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SpreadKind {
    /// Standard deviation over draws of the test frames, one network.
    #[default]
    Bootstrap,
    /// Standard deviation over networks of several seeds, the same test frames.
    Seeds,
}

/// A row of the tables.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MethodFigures {
    /// Kind of network that the row runs on.
    pub network: String,
    /// What the spreads are of.
    pub spread: SpreadKind,
    /// Seeds of the networks.
    pub seeds: Vec<u64>,
    /// Threshold that each seed's row stands at: best harmonic mean on the test frames (the paper's choice, an oracle).
    pub thresholds: Vec<f64>,
    /// AP of each known class.
    #[serde(default)]
    pub classes: BTreeMap<String, MeanSpread>,
    /// The same figures with thresholds chosen on the other half of the test frames: mean, and spread over seeds (0 with one).
    #[serde(default)]
    pub honest: BTreeMap<String, MeanSpread>,
    /// The sweep of the first seed, those points that keep nine tenths of the closed set's mAP.
    #[serde(default)]
    pub curve: Vec<SweepPoint>,
    /// `map_known`, `ap_unknown`, `map_harm`, `recall_unknown` and their companions at the chosen threshold.
    #[serde(flatten)]
    pub figures: BTreeMap<String, MeanSpread>,
}

impl MethodFigures {
    /// A figure by name; `None` where it was not taken.
    pub fn get(&self, name: &str) -> Option<MeanSpread> {
        self.figures.get(name).copied()
    }
}

/// A trained network.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct NetworkDetails {
    /// Kind of network.
    pub network: String,
    /// Seed.
    pub seed: u64,
    /// Steps of the optimiser.
    pub steps: u64,
    /// Frames a step.
    pub batch: u32,
    /// The command that trained it, or that would; "given" where the network lay in the runs' folder already.
    pub command: String,
    /// Commit of the trainer.
    pub commit: String,
    /// Fingerprint of the model file.
    pub fingerprint: String,
    /// Scores of its boxes on the test frames.
    pub separation: Vec<ScoreSeparation>,
}

/// A data set.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct DataOrigin {
    /// Part of it: train, supervised, val, test.
    pub split: String,
    /// Frames used.
    pub frames: usize,
    /// The command that makes it.
    pub command: String,
    /// FNV-1a over all labels, the sizes of all scans and the bytes of every 50th scan, in order.
    pub hash: String,
}

/// A step of our method, and what it brings.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct AblationRow {
    /// What is added, or left out.
    pub step: String,
    /// Figures with it.
    pub figures: MethodFigures,
}

/// A method on recorded scans, its network trained on simulated ones alone.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RealRow {
    /// The method.
    pub method: String,
    /// What the scans are.
    pub data: String,
    /// Frames.
    pub frames: usize,
    /// Threshold, chosen on simulated scans.
    pub threshold: f64,
    /// AP over all points, moderate, by class; `unknown` at overlap 0.1, cars at 0.5.
    pub ap_all: BTreeMap<String, f64>,
    /// AP of `unknown` where trams, Misc, sitting persons and what lies in DontCare regions are neither right nor wrong.
    pub ap_unknown_fair: Option<f64>,
    /// Labels that count, by class.
    pub labels: BTreeMap<String, usize>,
    /// Percent.
    pub recall_unknown: f64,
}

/// What belongs to a setting and to no single row.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Details {
    /// Data sets.
    pub data: Vec<DataOrigin>,
    /// Networks.
    pub networks: Vec<NetworkDetails>,
    /// Unknown labels that count on the test frames.
    pub unknown_labels: usize,
    /// Known labels that count, by class.
    pub known_labels: BTreeMap<String, usize>,
    /// Steps of our method.
    #[serde(default)]
    pub ablation: Vec<AblationRow>,
    /// Rows on recorded scans.
    #[serde(default)]
    pub real: Vec<RealRow>,
}

/// Where the figures come from.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Provenance {
    /// Commit of the program.
    pub commit: String,
    /// The command.
    pub command: String,
    /// Size of the plan: full or quick.
    pub size: String,
    /// Draws of the bootstrap and their seed.
    pub bootstrap: [u64; 2],
    /// Threads.
    pub threads: usize,
    /// How networks come to be, in a sentence.
    pub training: String,
}

/// Everything.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ReproductionReport {
    /// By setting.
    pub details: BTreeMap<String, Details>,
    /// Where the figures come from.
    pub provenance: Provenance,
    /// By setting (`sim-udi`, `sim-kitti`, `kitti`), then by method.
    #[serde(flatten)]
    pub settings: BTreeMap<String, BTreeMap<String, MethodFigures>>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn json_has_the_settings_at_the_top_and_reads_back() {
        let row = MethodFigures {
            network: "metric".into(),
            seeds: vec![1],
            thresholds: vec![1.25],
            figures: [("map_known".to_owned(), [71.5, 0.5])].into(),
            ..MethodFigures::default()
        };
        let report = ReproductionReport {
            settings: [(
                "sim-udi".to_owned(),
                [("paper-corrected".to_owned(), row)].into(),
            )]
            .into(),
            details: [("sim-udi".to_owned(), Details::default())].into(),
            ..ReproductionReport::default()
        };
        let text = serde_json::to_string(&report).expect("JSON");
        let value: serde_json::Value = serde_json::from_str(&text).expect("JSON");
        assert_eq!(value["sim-udi"]["paper-corrected"]["map_known"][0], 71.5);
        assert_eq!(value["sim-udi"]["paper-corrected"]["spread"], "bootstrap");
        assert_eq!(
            serde_json::from_str::<ReproductionReport>(&text).expect("a report"),
            report
        );
    }
}
