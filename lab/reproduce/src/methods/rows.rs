//! The rows of the paper's tables ("Open-set 3D Object Detection", tables 1 and 2; percent), and ours.

use crate::Result;
use mluc_evaluate::EvaluateError;
use mluc_model::{HeadKind, Model};
use mluc_train::NetworkKind;
use serde::Deserialize;
use std::sync::LazyLock;

/// A method.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// SECOND: no object is unknown.
    ClosedSet,
    /// SECOND, also trained on the unknown classes: the upper bound.
    Supervised,
    /// Unknown where the largest class probability is low; the box is unchanged.
    Naive,
    /// Points in no known box, clustered by a learned embedding (Wong et al., CoRL 2019, as the paper modified it).
    Osis,
    /// The same, clustered only by position.
    OsisGeo,
    /// The paper's gate; the box is unchanged.
    MlOnly,
    /// The naive gate with the paper's clustering.
    UcOnly,
    /// MLUC as printed in the paper.
    Paper,
    /// MLUC with the clustering's sign and ground corrected.
    PaperCorrected,
    /// The same on a network that also learned from synthetic unknown objects and background: the effect of training alone.
    MlucOpen,
    /// Our whole method.
    MlucFull,
}

/// A method's row in the tables.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct MethodRow {
    /// The method.
    pub method: Method,
    /// Key in `report.json`.
    pub key: String,
    /// The network that it runs on.
    pub network: NetworkKind,
    /// Name for people.
    pub title: String,
    /// Whether it is also evaluated on further seeds, where these are requested.
    #[serde(default)]
    pub seeded: bool,
    /// Metric learning and unsupervised clustering, as in table 1; `None` for a row only in table 2.
    #[serde(default)]
    pub ablation: Option<[bool; 2]>,
    /// The paper's mAP of the known, AP of the unknown and their harmonic mean, on its industrial park and on KITTI, where it has them.
    #[serde(default)]
    pub paper: [Option<[f64; 3]>; 2],
    /// Colour in figures, red, green, blue.
    pub color: [u8; 3],
}

/// Every row, in the order of the tables, which is the order of [`Method`].
pub static METHODS: LazyLock<Vec<MethodRow>> =
    LazyLock::new(|| serde_json::from_str(include_str!("methods.json")).expect("the table"));

impl MethodRow {
    /// The rows on a network of this kind and seed.
    pub(crate) fn on(network: NetworkKind, seed: u64) -> impl Iterator<Item = &'static MethodRow> {
        let is_on = move |row: &&MethodRow| row.network == network && (seed == 1 || row.seeded);
        METHODS.iter().filter(is_on)
    }
}

impl Method {
    /// Its row in the tables.
    pub fn row(self) -> &'static MethodRow {
        &METHODS[self as usize]
    }

    /// Rejects a model that the method cannot run on. Our method also runs on the paper's network, which shows the effect of training.
    pub fn check(self, model: &Model) -> Result<()> {
        let row = self.row();
        let (expected, found) = (row.network.head(), model.manifest.network.head);
        if found == expected || (self == Method::MlucFull && found == HeadKind::Metric) {
            return Ok(());
        }
        Err(EvaluateError::Input(format!(
            "{}: expected a model with a {expected:?} head, found a {found:?} head",
            row.key
        )))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mluc_evaluate::harmonic_mean;

    #[test]
    fn every_method_has_its_row_and_the_papers_harmonic_means_follow_from_its_figures() {
        assert_eq!(METHODS.len(), Method::MlucFull as usize + 1);
        for row in METHODS.iter() {
            assert_eq!(row.method.row(), row);
            let value = serde_json::from_value::<Method>(row.key.as_str().into());
            assert_eq!(value.expect("a method's name"), row.method);
            for [known, unknown, harm] in row.paper.into_iter().flatten() {
                let mean = harmonic_mean(known, unknown);
                // The paper's figures are rounded to 0.05.
                assert!((mean - harm).abs() < 0.11, "{}: {mean}, {harm}", row.key);
            }
        }
    }
}
