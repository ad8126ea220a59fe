//! The outcome of an evaluation, as it is kept between runs.

use crate::{Result, layout::write_whole};
use mluc_evaluate::pipeline::ScoreSeparation;
use mluc_evaluate::{EvaluateError, Honest, OpenSetFigures, SensorDetection, SweepPoint};
use serde::{Deserialize, Serialize};
use std::{collections::BTreeMap, path::Path};

/// Evaluations by the key of their row, the first seed first.
pub(crate) type ByRow = BTreeMap<&'static str, Vec<Evaluated>>;

/// A row judged on one network.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Evaluated {
    /// What it depends on: while this is the same, the evaluation need not be made again.
    pub(crate) key: String,
    pub(crate) network: String,
    pub(crate) seed: u64,
    /// The chosen threshold.
    pub(crate) threshold: f64,
    /// Figures there.
    pub(crate) figures: OpenSetFigures,
    /// Figures there where a look-alike (a van found as a car) is wrong, not ignored.
    pub(crate) strict: OpenSetFigures,
    /// Every named figure with its deviation over draws of the frames.
    pub(crate) bootstrap: BTreeMap<String, [f64; 2]>,
    pub(crate) honest: Option<Honest>,
    /// Every threshold, the closed set first.
    pub(crate) curve: Vec<SweepPoint>,
    /// How well the scores of the network's boxes separate; the same for every row on a network.
    pub(crate) separation: Vec<ScoreSeparation>,
    /// Unknown objects of a lower score are left out of pictures: one false alarm a frame in the mean.
    pub(crate) unknown_score_min: Option<f64>,
    /// What was found at the chosen threshold, frame by frame.
    pub(crate) objects: Vec<Vec<SensorDetection>>,
}

impl Evaluated {
    /// What is kept at a place, if it is of this key.
    pub(crate) fn read(path: &Path, key: &str) -> Option<Evaluated> {
        // A file that cannot be read or is of an older form is made again.
        let text = std::fs::read(path).ok()?;
        let kept: Evaluated = serde_json::from_slice(&text).ok()?;
        (kept.key == key).then_some(kept)
    }

    /// Every figure by the name that it has in a report.
    pub(crate) fn named(&self) -> Vec<(String, f64)> {
        let strict = [
            ("map_known_strict", self.strict.known.r40),
            ("map_known_strict_r11", self.strict.known.r11),
            ("map_harm_strict", self.strict.harmonic().r40),
        ];
        let strict = strict.map(|(name, value)| (name.to_owned(), value));
        self.figures.named().into_iter().chain(strict).collect()
    }

    pub(crate) fn write(&self, path: &Path) -> Result<()> {
        let bytes = serde_json::to_vec(self).map_err(|e| EvaluateError::file(path, e))?;
        write_whole(path, &bytes)
    }
}
