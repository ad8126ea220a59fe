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
    /// SECOND: nothing is unknown.
    ClosedSet,
    /// SECOND that learned the unknown classes too: the upper bound.
    Supervised,
    /// Unknown where the largest class probability is low; the box as it is.
    Naive,
    /// Points in no known box, clustered by a learned embedding (Wong et al., CoRL 2019, as the paper modified it).
    Osis,
    /// The same by place alone.
    OsisGeo,
    /// The paper's gate, the box as it is.
    MlOnly,
    /// The naive gate, the paper's clustering.
    UcOnly,
    /// MLUC as the paper prints it.
    Paper,
    /// MLUC with the clustering's sign and ground corrected.
    PaperCorrected,
    /// The same on a network that learned from synthetic unknown objects and background too: what training alone brings.
    MlucOpen,
    /// Our whole method.
    MlucFull,
}

/// A method's row in the tables.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct MethodRow {
    /// What is run.
    pub method: Method,
    /// Key in `report.json`.
    pub key: String,
    /// The network that it runs on.
    pub network: NetworkKind,
    /// Name for people.
    pub title: String,
    /// Whether it is judged on further seeds too, where those are asked for.
    #[serde(default)]
    pub seeded: bool,
    /// Metric learning and unsupervised clustering, as table 1 has them; `None` in table 2 alone.
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
    /// The rows on a kind of network of some seed.
    pub(crate) fn on(network: NetworkKind, seed: u64) -> impl Iterator<Item = &'static MethodRow> {
        let is_on = move |row: &&MethodRow| row.network == network && (seed == 1 || row.seeded);
        METHODS.iter().filter(is_on)
    }
}

impl Method {
    /// Its row.
    pub fn row(self) -> &'static MethodRow {
        &METHODS[self as usize]
    }

    /// Refuses a model that it cannot run on. Our method runs on the paper's network too, which shows what training brings.
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
                // The paper's inputs are rounded to 0.05.
                assert!((mean - harm).abs() < 0.11, "{}: {mean}, {harm}", row.key);
            }
        }
    }
}
