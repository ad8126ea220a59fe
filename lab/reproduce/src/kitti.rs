//! KITTI's object benchmark where a user has it: its splits in the trainer's form.

use crate::{Layout, Setting};
use mluc_dataset::{PrepareOptions, Splits};
use mluc_evaluate::pipeline::unknown_classes;
use std::path::PathBuf;

/// Where the benchmark lies.
#[derive(Clone, Debug)]
pub struct KittiSource {
    /// The folder with `training` (or `training` itself).
    pub root: PathBuf,
    /// Folder with `train.txt` and `val.txt`, where it is not ImageSets below the root.
    pub splits: Option<PathBuf>,
}

impl KittiSource {
    /// The splits by what they are for; training frames have no unknown object, the supervised network sees all of them.
    pub(crate) fn preparations(&self, layout: &Layout) -> [(&'static str, PrepareOptions); 3] {
        let of = |name, split: &str, drop_unknown, what, folder| {
            let options = PrepareOptions {
                splits: Splits {
                    root: self.root.clone(),
                    folder: self.splits.clone(),
                },
                split: split.to_owned(),
                drop_unknown,
                unknown: unknown_classes(Setting::Kitti.trainer_name()),
                out: layout.data_of(Setting::Kitti, what).join(folder),
            };
            (name, options)
        };
        [
            of("train", "train", true, "", "train"),
            of("supervised", "train", false, "-supervised", "train"),
            of("test", "val", false, "", "test"),
        ]
    }
}
