//! What a reproduction is asked for, where it shows how far it is, and the frames that its figures are taken on.

use crate::{Layout, Result, Setting, Size, setting::Sizes};
use mluc_dataset::{Dataset, Splits, data_hash};
use mluc_evaluate::pipeline::FrameSet;
use std::{collections::BTreeMap, path::PathBuf};

/// What a reproduction can be told.
#[derive(Clone, Debug)]
pub struct Options {
    /// Folders.
    pub layout: Layout,
    /// What to make tables of.
    pub settings: Vec<Setting>,
    /// Size of the plan.
    pub size: Size,
    /// Test scans, where not the plan's number.
    pub test_frames: Option<u32>,
    /// Networks of the kinds that are trained more than once.
    pub seeds: u64,
    /// Train what is missing or unfinished; otherwise rows without a network are left out.
    pub train: bool,
    /// This program, which trains in a process of its own.
    pub program: PathBuf,
    /// Commit of the program.
    pub commit: String,
    /// The command, for the report.
    pub command: String,
    /// Folders of recorded scans on which the rows of `sim-kitti` are shown too.
    pub real: Vec<PathBuf>,
    /// KITTI's benchmark, for [`Setting::Kitti`].
    pub kitti: Option<Splits>,
}

impl Options {
    pub(crate) fn sizes(&self, setting: Setting) -> Sizes {
        let sizes = self.size.sizes(setting);
        Sizes {
            test_frames: self.test_frames.unwrap_or(sizes.test_frames),
            ..sizes
        }
    }
}

/// Where a reproduction shows how far it is. Called from many threads.
pub trait Screen: Sync {
    /// A step begins: its number from 1, how many there are, what it is.
    fn step(&self, number: usize, steps: usize, name: &str);
    /// Something of so many parts begins.
    fn count(&self, what: &str, total: u64);
    /// A part is done.
    fn tick(&self);
    /// Something worth a line.
    fn note(&self, text: &str);
    /// Another program is about to write to the terminal.
    fn clear(&self);
}

/// By setting.
pub(crate) type Tests = BTreeMap<Setting, TestFrames>;

/// The frames that the figures of a setting are taken on.
pub(crate) struct TestFrames {
    pub(crate) setting: Setting,
    pub(crate) set: FrameSet,
    /// Of labels and scans.
    pub(crate) hash: String,
    pub(crate) resamples: usize,
}

impl TestFrames {
    pub(crate) fn open(options: &Options, setting: Setting) -> Result<TestFrames> {
        let folder = options.layout.data_of(setting, "").join("test");
        let sizes = options.sizes(setting);
        let is_whole = options.size == Size::Full && options.test_frames.is_none();
        let frames = match setting {
            // All of a recorded split, unless fewer are asked for.
            Setting::Kitti if is_whole => usize::MAX,
            _ => sizes.test_frames as usize,
        };
        let set = FrameSet::open(&folder, None, frames)?;
        Ok(TestFrames {
            setting,
            hash: data_hash(&Dataset::open(&folder)?, set.names().len())?,
            set,
            resamples: sizes.resamples,
        })
    }
}
