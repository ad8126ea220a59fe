//! KITTI's object benchmark where a user has it: its splits in the trainer's form.

use crate::{Layout, ReproduceError, Setting};
use mluc_dataset::{PrepareOptions, Splits, UnknownPolicy, prepare};
use std::path::PathBuf;

/// Where the benchmark lies, and what becomes of unknown objects in training.
#[derive(Clone, Debug)]
pub struct KittiSource {
    /// The folder with `training` (or `training` itself).
    pub root: PathBuf,
    /// Folder with `train.txt` and `val.txt`, where it is not ImageSets below the root.
    pub splits: Option<PathBuf>,
    /// What training sees of unknown objects.
    pub policy: UnknownPolicy,
}

/// A split to be brought into the trainer's form.
#[derive(Clone, Debug, PartialEq)]
pub struct Preparation {
    /// What it is for: train, supervised, test.
    pub name: &'static str,
    pub(crate) options: PrepareOptions,
}

impl KittiSource {
    /// The splits: training frames by the policy, all training frames for the supervised network, validation frames to judge on.
    pub(crate) fn preparations(&self, layout: &Layout) -> Vec<Preparation> {
        let root = layout.data_of(Setting::Kitti);
        let of = |name, split: &str, policy, folder: PathBuf| Preparation {
            name,
            options: PrepareOptions {
                splits: Splits {
                    root: self.root.clone(),
                    folder: self.splits.clone(),
                },
                split: split.to_owned(),
                policy,
                unknown: mluc_evaluate::pipeline::unknown_classes(Setting::Kitti.trainer_name()),
                out: folder,
            },
        };
        vec![
            of("train", "train", Some(self.policy), root.join("train")),
            of(
                "supervised",
                "train",
                None,
                layout.supervised_data_of(Setting::Kitti).join("train"),
            ),
            of("test", "val", None, root.join("test")),
        ]
    }
}

impl Preparation {
    /// The command that does the same.
    pub fn command(&self) -> String {
        let o = &self.options;
        let policy = o.policy.map_or("keep", UnknownPolicy::name);
        format!(
            "mluc-lab audit --root KITTI --prepare {} --policy {policy} --out {}",
            o.split,
            o.out.display()
        )
    }

    /// Whether the folder is there.
    pub(crate) fn is_done(&self) -> bool {
        self.options.out.is_dir()
    }

    pub(crate) fn run(&self, step: impl Fn() + Sync) -> Result<(), ReproduceError> {
        Ok(prepare(&self.options, step)?)
    }
}
