//! Locations of all files.

use crate::{Result, Setting};
use mluc_dataset::whole_file;
use mluc_evaluate::EvaluateError;
use mluc_train::NetworkKind;
use std::path::{Path, PathBuf};

/// A network: its setting, its kind, its seed.
pub(crate) type Run = (Setting, NetworkKind, u64);

/// The three folders of a reproduction.
///
/// ```text
/// DATA/sim-udi/{train,val,test}          simulated scans
/// DATA/sim-udi-supervised/train          with unknown classes, labelled
/// DATA/sim-udi-synthetic-unknown/train   with synthetic unknown objects, made of known ones
/// RUNS/sim-udi/NETWORK[-sSEED]/          one run of the trainer: model.safetensors, checkpoint, log
/// RUNS/sim-udi/evaluations/METHOD[-sSEED].json
/// OUT/                                   the report
/// ```
#[derive(Clone, Debug)]
pub(crate) struct Layout {
    /// Data sets.
    pub(crate) data: PathBuf,
    /// Networks and evaluations.
    pub(crate) runs: PathBuf,
    /// The report.
    pub(crate) out: PathBuf,
}

impl Layout {
    /// Folder of a setting's data; `what` is empty, `-supervised` or `-synthetic-unknown`.
    pub(crate) fn data_of(&self, setting: Setting, what: &str) -> PathBuf {
        self.data.join(format!("{}{what}", setting.name()))
    }

    pub(crate) fn run_of(&self, (setting, network, seed): Run) -> PathBuf {
        let run = with_seed(&network.name(), seed);
        self.runs.join(setting.name()).join(run)
    }

    pub(crate) fn model_of(&self, run: Run) -> PathBuf {
        self.run_of(run).join("model.safetensors")
    }

    pub(crate) fn evaluation_of(&self, setting: Setting, method: &str, seed: u64) -> PathBuf {
        let file = format!("{}.json", with_seed(method, seed));
        self.runs.join(setting.name()).join("evaluations").join(file)
    }
}

/// The first seed is omitted from the name.
fn with_seed(name: &str, seed: u64) -> String {
    let numbered = format!("{name}-s{seed}");
    if seed == 1 { name.to_owned() } else { numbered }
}

/// Writes a file completely or not at all. Creates the folder.
pub(crate) fn write_whole(path: &Path, bytes: &[u8]) -> Result<()> {
    let folder = path.parent().unwrap_or(path);
    std::fs::create_dir_all(folder).map_err(|e| EvaluateError::file(folder, e))?;
    whole_file::write_whole(path, bytes).map_err(|e| EvaluateError::file(path, e))
}
