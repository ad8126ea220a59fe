//! The result of an evaluation, as stored between runs.

use crate::{Result, layout::write_whole};
use mluc_evaluate::pipeline::ScoreSeparation;
use mluc_evaluate::{EvaluateError, Honest, OpenSetFigures, SensorDetection, SweepPoint};
use serde::{Deserialize, Serialize};
use std::{collections::BTreeMap, path::Path};

/// Evaluations by the key of their row, in the order of the seeds.
pub(crate) type ByRow = BTreeMap<&'static str, Vec<Evaluated>>;

/// The evaluation of a row on one network.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Evaluated {
    /// Everything that the evaluation depends on: while the key is the same, it is not made again.
    pub(crate) key: String,
    pub(crate) network: String,
    pub(crate) seed: u64,
    pub(crate) threshold: f64,
    /// Figures at the chosen threshold.
    pub(crate) figures: OpenSetFigures,
    /// Figures at the chosen threshold where a similar object (a van found as a car) is wrong, not ignored.
    pub(crate) strict: OpenSetFigures,
    /// Every named figure with its deviation over resamples of the frames.
    pub(crate) bootstrap: BTreeMap<String, [f64; 2]>,
    pub(crate) honest: Option<Honest>,
    /// Figures at every threshold, closed set first.
    pub(crate) curve: Vec<SweepPoint>,
    /// Separation by the scores of the network's boxes; the same for every row on a network.
    pub(crate) separation: Vec<ScoreSeparation>,
    /// Pictures leave out unknown objects with a lower score: on average one false alarm per frame.
    pub(crate) unknown_score_min: Option<f64>,
    /// Objects at the chosen threshold, frame by frame.
    pub(crate) objects: Vec<Vec<SensorDetection>>,
}

impl Evaluated {
    /// Reads the evaluation at `path`, if it has this key.
    pub(crate) fn read(path: &Path, key: &str) -> Option<Evaluated> {
        // A file that cannot be read or has an older format is made again.
        let text = std::fs::read(path).ok()?;
        let kept: Evaluated = serde_json::from_slice(&text).ok()?;
        (kept.key == key).then_some(kept)
    }

    /// Every figure with its name in a report.
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
