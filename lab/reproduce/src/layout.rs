//! Where everything lies.

use crate::Setting;
use mluc_train::NetworkKind;
use std::path::PathBuf;

/// The three folders of a reproduction.
///
/// ```text
/// DATA/sim-udi/{train,val,test}          simulated scans
/// DATA/sim-udi-supervised/train          with unknown classes, labelled
/// DATA/sim-udi-synthetic-unknown/train   with synthetic unknown objects, made up of known ones
/// RUNS/sim-udi/NETWORK[-sSEED]/          one run of the trainer: model.safetensors, checkpoint, log
/// RUNS/sim-udi/evaluations/METHOD[-sSEED].json
/// OUT/                                   the report
/// ```
#[derive(Clone, Debug)]
pub struct Layout {
    /// Data sets.
    pub data: PathBuf,
    /// Networks and evaluations.
    pub runs: PathBuf,
    /// The report.
    pub out: PathBuf,
}

impl Layout {
    /// Folder of a setting's data: `train`, `val`, `test` below it.
    pub fn data_of(&self, setting: Setting) -> PathBuf {
        self.data.join(setting.name())
    }

    /// Folder of the supervised network's data: `train` below it.
    pub fn supervised_data_of(&self, setting: Setting) -> PathBuf {
        self.data.join(format!("{}-supervised", setting.name()))
    }

    /// Folder of the data with synthetic unknown objects: `train` below it.
    pub fn synthetic_unknown_data_of(&self, setting: Setting) -> PathBuf {
        self.data
            .join(format!("{}-synthetic-unknown", setting.name()))
    }

    /// Folder of a network's run.
    pub fn run_of(&self, setting: Setting, network: NetworkKind, seed: u64) -> PathBuf {
        self.runs
            .join(setting.name())
            .join(with_seed(network.name(), seed))
    }

    /// Its model file.
    pub fn model_of(&self, setting: Setting, network: NetworkKind, seed: u64) -> PathBuf {
        self.run_of(setting, network, seed)
            .join("model.safetensors")
    }

    /// Where a row's evaluation is kept.
    pub fn evaluation_of(&self, setting: Setting, method: &str, seed: u64) -> PathBuf {
        let file = format!("{}.json", with_seed(method, seed));
        self.runs
            .join(setting.name())
            .join("evaluations")
            .join(file)
    }
}

/// The first seed goes without saying.
fn with_seed(name: &str, seed: u64) -> String {
    if seed == 1 {
        name.to_owned()
    } else {
        format!("{name}-s{seed}")
    }
}
