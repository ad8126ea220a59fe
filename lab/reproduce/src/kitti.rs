//! KITTI's object benchmark where a user has it: its splits in the trainer's form.

use crate::{Layout, Setting};
use mluc_dataset::{PrepareOptions, Splits, UnknownPolicy};
use mluc_evaluate::pipeline::unknown_classes;
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

impl KittiSource {
    /// The splits by what they are for; the policy is the training frames' alone, the supervised network sees all of them.
    pub(crate) fn preparations(&self, layout: &Layout) -> [(&'static str, PrepareOptions); 3] {
        let of = |name, split: &str, policy, what, folder| {
            let options = PrepareOptions {
                splits: Splits {
                    root: self.root.clone(),
                    folder: self.splits.clone(),
                },
                split: split.to_owned(),
                policy,
                unknown: unknown_classes(Setting::Kitti.trainer_name()),
                out: layout.data_of(Setting::Kitti, what).join(folder),
            };
            (name, options)
        };
        [
            of("train", "train", Some(self.policy), "", "train"),
            of("supervised", "train", None, "-supervised", "train"),
            of("test", "val", None, "", "test"),
        ]
    }
}
