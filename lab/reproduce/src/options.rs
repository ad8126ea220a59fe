//! Options of a reproduction, its progress display, and the frames of its figures.

use crate::{Layout, Result, Setting, setting::Sizes};
use clap::{ArgAction, Parser};
use mluc_dataset::{Dataset, Splits, data_hash};
use mluc_evaluate::pipeline::FrameSet;
use std::{collections::BTreeMap, path::PathBuf};

/// What a reproduction can be told.
#[derive(Clone, Debug, Parser)]
pub struct Options {
    /// Only this setting: udi (industrial park, all around) or kitti (streets, ahead) [default: both, simulated].
    #[arg(long, value_enum, hide_possible_values = true)]
    #[arg(conflicts_with = "dataset")]
    setting: Option<Setting>,
    /// Number of networks, each with its own seed, for the rows naive, MLUC and mluc-full. With two or more, ± is their standard deviation.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=20))]
    pub(crate) seeds: u64,
    /// A few small scans and a few steps: shows that everything works; the figures mean little.
    #[arg(long)]
    quick: bool,
    /// Smaller still, for tests.
    #[arg(long, hide = true)]
    smoke: bool,
    /// Judge on so many test scans instead of the plan's number.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=1_000_000))]
    test_frames: Option<u32>,
    /// Train nothing: rows whose network does not lie in --runs are left out.
    #[arg(long = "no-train", action = ArgAction::SetFalse)]
    pub(crate) train: bool,
    /// Folder of the report [default: RUNS/report].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Folder of data sets, simulated where missing [default: data, with --quick data/quick].
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Folder of networks and evaluations [default: runs, with --quick runs/quick].
    #[arg(long, value_name = "DIR")]
    runs: Option<PathBuf>,
    /// Recorded scans in KITTI's format on which the rows of sim-kitti are shown too, nothing being chosen on them. Can be repeated.
    #[arg(long, value_name = "DIR")]
    pub(crate) real: Vec<PathBuf>,
    /// Tables on KITTI's object benchmark instead: needs --root.
    #[arg(long, value_parser = ["kitti"], requires = "root")]
    dataset: Option<String>,
    /// Folder of KITTI's object benchmark: training/ with velodyne, label_2 and calib; ImageSets with train.txt and val.txt.
    #[arg(long, value_name = "DIR", requires = "dataset")]
    root: Option<PathBuf>,
    /// Folder with train.txt and val.txt [default: ImageSets in or beside --root].
    #[arg(long, value_name = "DIR", requires = "dataset")]
    splits: Option<PathBuf>,
    /// This program, which trains in a process of its own.
    #[arg(skip)]
    pub program: PathBuf,
    /// Commit of the program.
    #[arg(skip)]
    pub commit: String,
}

impl Options {
    /// Size of the plan. `full`: meaningful figures, hours on two cores. `quick`: the whole process in twelve minutes; the figures mean little.
    /// `smoke`: a minute, for tests; the figures mean nothing.
    pub(crate) fn size(&self) -> &'static str {
        match (self.smoke, self.quick) {
            (true, _) => "smoke",
            (false, true) => "quick",
            (false, false) => "full",
        }
    }

    pub(crate) fn layout(&self) -> Layout {
        let below = |folder: &str| match self.size() {
            "full" => PathBuf::from(folder),
            size => PathBuf::from(folder).join(size),
        };
        let runs = self.runs.clone().unwrap_or_else(|| below("runs"));
        Layout {
            data: self.data.clone().unwrap_or_else(|| below("data")),
            out: self.out.clone().unwrap_or_else(|| runs.join("report")),
            runs,
        }
    }

    /// The settings to make tables of.
    pub(crate) fn settings(&self) -> Vec<Setting> {
        match (&self.dataset, self.setting) {
            (Some(_), _) => vec![Setting::Kitti],
            (None, Some(setting)) => vec![setting],
            (None, None) => vec![Setting::SimUdi, Setting::SimKitti],
        }
    }

    /// KITTI's benchmark, for [`Setting::Kitti`].
    pub(crate) fn kitti(&self) -> Option<Splits> {
        let (root, folder) = (self.root.clone()?, self.splits.clone());
        Some(Splits { root, folder })
    }

    /// The command for a reader to repeat: without folders of this machine.
    pub(crate) fn command(&self) -> String {
        let mut text = "mluc-lab reproduce".to_owned();
        if let Some(dataset) = &self.dataset {
            text += &format!(" --dataset {dataset} --root DIR");
            text += self.splits.as_ref().map_or("", |_| " --splits DIR");
        } else if let Some(setting) = self.setting {
            text += &format!(" --setting {}", setting.trainer_name());
        }
        if self.seeds > 1 {
            text += &format!(" --seeds {}", self.seeds);
        }
        if self.size() != "full" {
            text += &format!(" --{}", self.size());
        }
        if let Some(frames) = self.test_frames {
            text += &format!(" --test-frames {frames}");
        }
        if !self.train {
            text += " --no-train";
        }
        text + &" --real DIR".repeat(self.real.len())
    }

    pub(crate) fn sizes(&self, setting: Setting) -> Sizes {
        let sizes = Sizes::of(self.size(), setting);
        Sizes { test_frames: self.test_frames.unwrap_or(sizes.test_frames), ..sizes }
    }
}

/// Progress display of a reproduction. Called from many threads.
pub trait Screen: Sync {
    /// A step starts: its number from 1, the number of steps, its name.
    fn step(&self, number: usize, steps: usize, name: &str);
    /// Work with `total` parts starts.
    fn count(&self, what: &str, total: u64);
    /// A part is finished.
    fn tick(&self);
    /// A message for the user.
    fn note(&self, text: &str);
    /// Another program is about to write to the terminal.
    fn clear(&self);
}

/// Test frames by setting.
pub(crate) type Tests = BTreeMap<Setting, TestFrames>;

/// The frames on which the figures of a setting are computed.
pub(crate) struct TestFrames {
    pub(crate) setting: Setting,
    pub(crate) set: FrameSet,
    /// Hash of labels and scans.
    pub(crate) hash: String,
    pub(crate) resamples: usize,
}

impl TestFrames {
    pub(crate) fn open(options: &Options, setting: Setting) -> Result<TestFrames> {
        let folder = options.layout().data_of(setting, "").join("test");
        let sizes = options.sizes(setting);
        let is_whole = options.size() == "full" && options.test_frames.is_none();
        let frames = match setting {
            // All frames of a recorded split, unless fewer are requested.
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
