//! The step that simulates a split, if it is not there.

use crate::{Layout, ReproduceError, Setting, Sizes};
use mluc_dataset::read_text;
use mluc_simulate::{ExportOptions, Family, Realism, Split, export};
use std::path::{Path, PathBuf};

/// Seed of the simulated training, validation and test scans.
const SEED: u64 = 1;
/// Seed of the supervised network's scans. They are drawn like validation scans, which show unknown objects, with another
/// seed, so that no layout and no object is in two data sets.
const SUPERVISED_SEED: u64 = 101;

/// Seed of the scans with synthetic unknown objects: training scans of known classes with other layouts.
const SYNTHETIC_UNKNOWN_SEED: u64 = 201;

/// A split to be simulated.
#[derive(Clone, Debug, PartialEq)]
pub struct Simulation {
    /// What it is for: train, supervised, synthetic-unknown, val, test.
    pub name: &'static str,
    pub(crate) family: Family,
    pub(crate) split: Split,
    pub(crate) seed: u64,
    pub(crate) synthetic_unknown: bool,
    /// Frames.
    pub frames: u32,
    /// Where it goes.
    pub folder: PathBuf,
}

impl Simulation {
    /// The splits of a setting: train, val, test, then the supervised network's and that with synthetic unknown objects.
    pub(crate) fn all(layout: &Layout, setting: Setting, sizes: &Sizes) -> Vec<Simulation> {
        let Some(family) = setting.family() else {
            return Vec::new();
        };
        let root = layout.data_of(setting);
        let supervised = layout.supervised_data_of(setting).join("train");
        let synthetic = layout.synthetic_unknown_data_of(setting).join("train");
        let splits = [
            (
                "train",
                Split::Train,
                SEED,
                sizes.train_frames,
                root.join("train"),
            ),
            ("val", Split::Val, SEED, sizes.val_frames, root.join("val")),
            (
                "test",
                Split::Test,
                SEED,
                sizes.test_frames,
                root.join("test"),
            ),
            (
                "supervised",
                Split::Val,
                SUPERVISED_SEED,
                sizes.supervised_frames,
                supervised,
            ),
            (
                "synthetic-unknown",
                Split::Train,
                SYNTHETIC_UNKNOWN_SEED,
                sizes.train_frames,
                synthetic,
            ),
        ];
        let simulation = |(name, split, seed, frames, folder)| Simulation {
            name,
            family,
            split,
            seed,
            synthetic_unknown: seed == SYNTHETIC_UNKNOWN_SEED,
            frames,
            folder,
        };
        splits.map(simulation).into()
    }

    /// The command that does the same.
    pub fn command(&self) -> String {
        format!(
            "mluc-lab simulate --family {} --split {}{} --frames {} --seed {} --out {}",
            self.family.name(),
            self.split.name(),
            if self.synthetic_unknown {
                " --synthetic-unknown"
            } else {
                ""
            },
            self.frames,
            self.seed,
            self.folder.display()
        )
    }

    /// Whether the folder holds at least the frames that are wanted. One that holds something else is an error: it is somebody's.
    pub fn is_done(&self) -> Result<bool, ReproduceError> {
        if is_empty(&self.folder)? {
            return Ok(false);
        }
        // The simulator writes the list last.
        let list = self
            .folder
            .join("ImageSets")
            .join(format!("{}.txt", self.split.name()));
        let found = if list.is_file() {
            let text = read_text(&list)?;
            text.lines().filter(|line| !line.trim().is_empty()).count()
        } else {
            0
        };
        let expected = self.frames as usize;
        if found < expected {
            let what = format!(
                "expected a data set of at least {expected} frames, found {found}; move it away to have it simulated, or name another --data"
            );
            return Err(ReproduceError::file(&self.folder, what));
        }
        Ok(true)
    }

    /// Simulates into a folder beside the place, then moves it there: an interrupted simulation leaves nothing half done.
    pub(crate) fn run(&self, step: impl Fn() + Sync) -> Result<(), ReproduceError> {
        let beside = mluc_dataset::whole_file::beside(&self.folder);
        if beside.is_dir() {
            std::fs::remove_dir_all(&beside).map_err(|e| ReproduceError::file(&beside, e))?;
        }
        let options = ExportOptions {
            family: self.family,
            split: self.split,
            frames: self.frames,
            sequence: None,
            seed: self.seed,
            realism: Realism::FULL,
            synthetic_unknown: self.synthetic_unknown,
            folder: beside.clone(),
            threads: 0,
        };
        export(&options, step)?;
        std::fs::rename(&beside, &self.folder).map_err(|e| ReproduceError::file(&self.folder, e))
    }
}

/// Whether a folder is missing or holds nothing.
fn is_empty(folder: &Path) -> Result<bool, ReproduceError> {
    if !folder.exists() {
        return Ok(true);
    }
    let mut entries = std::fs::read_dir(folder).map_err(|e| ReproduceError::file(folder, e))?;
    Ok(entries.next().is_none())
}
