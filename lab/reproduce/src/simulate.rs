//! The step that simulates a split, if it is missing.

use crate::{Layout, Result, Setting, setting::Sizes};
use mluc_dataset::{read_text, whole_file};
use mluc_evaluate::EvaluateError;
use mluc_simulate::{ExportOptions, Split, export};

/// Seed of the simulated training, validation and test scans.
const SEED: u64 = 1;
/// Seed of the supervised network's scans. They are drawn like validation scans, which have unknown objects, but with another
/// seed, so that no layout and no object is in two data sets.
const SUPERVISED_SEED: u64 = 101;
/// Seed of the scans with synthetic unknown objects: training scans of known classes with other layouts.
const SYNTHETIC_SEED: u64 = 201;

pub(crate) struct Simulation {
    /// Its purpose: train, supervised, synthetic-unknown, val, test.
    pub(crate) name: &'static str,
    pub(crate) options: ExportOptions,
}

impl Simulation {
    /// The splits of a setting; none for recorded scans.
    pub(crate) fn all(layout: &Layout, setting: Setting, sizes: &Sizes) -> Vec<Simulation> {
        let Some(family) = setting.family() else {
            return Vec::new();
        };
        let of = |(name, frames, split, seed): (&'static str, u32, Split, u64)| {
            // Data of other seeds are separate training sets.
            let (what, folder) =
                if seed == SEED { (String::new(), name) } else { (format!("-{name}"), "train") };
            let folder = layout.data_of(setting, &what).join(folder);
            let mut options = ExportOptions::new(family, split, frames, seed, folder);
            options.synthetic_unknown = seed == SYNTHETIC_SEED;
            Simulation { name, options }
        };
        let [train, supervised] = [sizes.train_frames, sizes.supervised_frames];
        let splits = [
            ("train", train, Split::Train, SEED),
            ("val", sizes.val_frames, Split::Val, SEED),
            ("test", sizes.test_frames, Split::Test, SEED),
            ("supervised", supervised, Split::Val, SUPERVISED_SEED),
            ("synthetic-unknown", train, Split::Train, SYNTHETIC_SEED),
        ];
        splits.map(of).into()
    }

    pub(crate) fn command(&self) -> String {
        let o = &self.options;
        let synthetic = ["", " --synthetic-unknown"][usize::from(o.synthetic_unknown)];
        format!(
            "mluc-lab simulate --family {} --split {}{synthetic} --frames {} --seed {} --out {}",
            o.family.name(),
            o.split.name(),
            o.frames,
            o.seed,
            o.folder.display()
        )
    }

    /// Whether the folder contains at least the wanted frames. A folder with other contents is an error: it may belong to the user.
    pub(crate) fn is_done(&self) -> Result<bool> {
        let folder = &self.options.folder;
        let unreadable = |e| EvaluateError::file(folder, e);
        let entries = || folder.read_dir().map_err(unreadable);
        if !folder.exists() || entries()?.next().is_none() {
            return Ok(false);
        }
        // The simulator writes the list last.
        let list = format!("ImageSets/{}.txt", self.options.split.name());
        let list = folder.join(list);
        let text = list.is_file().then(|| read_text(&list)).transpose()?;
        let found = text.unwrap_or_default().lines().filter(|line| !line.trim().is_empty()).count();
        let expected = self.options.frames as usize;
        if found < expected {
            let what = format!(
                "expected a data set of at least {expected} frames, found {found}; move it away to have it simulated, or name another --data"
            );
            return Err(EvaluateError::file(folder, what));
        }
        Ok(true)
    }

    /// Simulates into a temporary folder next to the target, then moves it: an interrupted simulation leaves no incomplete data set.
    pub(crate) fn run(&self, step: impl Fn() + Sync) -> Result<()> {
        let folder = &self.options.folder;
        let beside = whole_file::beside(folder);
        if beside.is_dir() {
            std::fs::remove_dir_all(&beside).map_err(|e| EvaluateError::file(&beside, e))?;
        }
        let mut options = self.options.clone();
        options.folder = beside.clone();
        export(&options, step).map_err(|e| EvaluateError::Input(e.to_string()))?;
        std::fs::rename(&beside, folder).map_err(|e| EvaluateError::file(folder, e))
    }
}
