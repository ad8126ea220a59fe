//! The step that simulates a split, if it is not there.

use super::layout::Layout;
use super::{ReproduceError, Setting};
use crate::dataset::read_text;
use crate::simulate::{ExportOptions, Family, Realism, Split, export};
use std::path::{Path, PathBuf};

/// Seed of the simulated training, validation and test scans.
const SEED: u64 = 1;
/// Seed of the supervised network's scans. They are drawn like validation scans, which show unknown objects, with another
/// seed, so that no layout and no object is in two data sets.
const SUPERVISED_SEED: u64 = 101;

/// Seed of the scans with made-up objects: training scans of known classes with other layouts.
const MADE_UP_SEED: u64 = 201;

/// A split to be simulated.
#[derive(Clone, Debug, PartialEq)]
pub struct Simulation {
    /// What it is for: train, supervised, made-up, val, test.
    pub name: &'static str,
    pub(super) family: Family,
    pub(super) split: Split,
    pub(super) seed: u64,
    pub(super) made_up: bool,
    /// Frames.
    pub frames: u32,
    /// Where it goes.
    pub folder: PathBuf,
}

impl Simulation {
    /// The splits of a setting: train, val, test, then the supervised network's and that with made-up objects.
    pub(super) fn all(layout: &Layout, setting: Setting, sizes: &super::Sizes) -> Vec<Simulation> {
        let Some(family) = setting.family() else {
            return Vec::new();
        };
        let root = layout.data_of(setting);
        let split = |name, split: Split, seed, frames, folder: PathBuf| Simulation {
            name,
            family,
            split,
            seed,
            made_up: false,
            frames,
            folder,
        };
        let made_up = Simulation {
            made_up: true,
            ..split(
                "made-up",
                Split::Train,
                MADE_UP_SEED,
                sizes.train_frames,
                layout.made_up_data_of(setting).join("train"),
            )
        };
        vec![
            split(
                "train",
                Split::Train,
                SEED,
                sizes.train_frames,
                root.join("train"),
            ),
            split("val", Split::Val, SEED, sizes.val_frames, root.join("val")),
            split(
                "test",
                Split::Test,
                SEED,
                sizes.test_frames,
                root.join("test"),
            ),
            split(
                "supervised",
                Split::Val,
                SUPERVISED_SEED,
                sizes.supervised_frames,
                layout.supervised_data_of(setting).join("train"),
            ),
            made_up,
        ]
    }

    /// The command that does the same.
    pub fn command(&self) -> String {
        format!(
            "mluc-lab simulate --family {} --split {}{} --frames {} --seed {} --out {}",
            self.family.name(),
            self.split.name(),
            if self.made_up { " --made-up" } else { "" },
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
        let found = match list.is_file() {
            true => read_text(&list)?
                .lines()
                .filter(|line| !line.trim().is_empty())
                .count(),
            false => 0,
        };
        let expected = self.frames as usize;
        if found < expected {
            let path = self.folder.clone();
            return Err(ReproduceError::TooFewFrames {
                path,
                expected,
                found,
            });
        }
        Ok(true)
    }

    /// Simulates into a folder beside the place, then moves it there: an interrupted simulation leaves nothing half done.
    pub(super) fn run(&self, step: impl Fn() + Sync) -> Result<(), ReproduceError> {
        let beside = crate::whole_file::beside(&self.folder);
        if beside.is_dir() {
            std::fs::remove_dir_all(&beside).map_err(ReproduceError::io(&beside))?;
        }
        let options = ExportOptions {
            family: self.family,
            split: self.split,
            frames: self.frames,
            sequence: None,
            seed: self.seed,
            realism: Realism::FULL,
            made_up: self.made_up,
            folder: beside.clone(),
            threads: 0,
        };
        export(&options, step)?;
        std::fs::rename(&beside, &self.folder).map_err(ReproduceError::io(&self.folder))
    }
}

/// Whether a folder is missing or holds nothing.
fn is_empty(folder: &Path) -> Result<bool, ReproduceError> {
    if !folder.exists() {
        return Ok(true);
    }
    let mut entries = std::fs::read_dir(folder).map_err(ReproduceError::io(folder))?;
    Ok(entries.next().is_none())
}
