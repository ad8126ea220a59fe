//! Messages of the supervisor to the stages and to `mluc monitor` during a run: a file in the instance's folder, read before each frame.

use crate::model::PinnedModel;
use anyhow::Context;
use mluc_ipc_types::FrameHeader;
use mluc_model::ScoreMin;
use mluc_runtime::Instance;
use serde::{Deserialize, Serialize};
use std::{collections::BTreeSet, os::unix::fs::MetadataExt, path::PathBuf, time::SystemTime};

/// The role of the supervisor in the instance.
pub(crate) const ROLE: &str = "pipeline";

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Control {
    /// Indices of scans that kill stages: an empty frame takes the place of each.
    pub(crate) set_aside: BTreeSet<u64>,
    /// Restarts of each stage since the supervisor began.
    pub(crate) restarts: [u32; 4],
    /// At pace `complete`: ingest must not send the next frame yet.
    pub(crate) holds: bool,
    /// The last reload; before the first one, a stage's own settings apply.
    pub(crate) reload: Option<Reload>,
    /// Number of requests for a reload so far, whether the last one was refused, and its result in words.
    pub(crate) answer: (u64, bool, String),
}

/// The threshold of the model's gate, and the scores from which objects are published.
pub(crate) type Thresholds = (f32, ScoreMin);

/// All stages compute a frame with the same model and judge it by the same thresholds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Reload {
    /// The run, and its first frame that is judged by the new thresholds.
    pub(crate) run_id: u64,
    pub(crate) from_sequence: u64,
    /// Another model, which the stages make ready. The new thresholds apply to the frames of this model.
    pub(crate) model: Option<PinnedModel>,
    pub(crate) old: Thresholds,
    pub(crate) new: Thresholds,
}

impl Control {
    fn path(instance: &Instance) -> PathBuf {
        instance.root().join("control.json")
    }

    /// Writes the file; readers never see a part of it.
    pub(crate) fn write(&self, instance: &Instance) -> anyhow::Result<()> {
        let path = Control::path(instance);
        let new = path.with_extension("new");
        let text = serde_json::to_vec(self)?;
        let written = std::fs::write(&new, text).and_then(|()| std::fs::rename(&new, &path));
        written.with_context(|| format!("writing {}", path.display()))
    }

    /// The thresholds for a frame; `None`: the ones of the stage's settings apply.
    pub(crate) fn thresholds_of(&self, header: &FrameHeader) -> Option<Thresholds> {
        let reload = self.reload.as_ref()?;
        let is_before = match &reload.model {
            Some(next) => header.model_fingerprint != next.fingerprint,
            None => header.sequence < reload.from_sequence,
        };
        let is_old = header.run_id == reload.run_id && is_before;
        Some(if is_old { reload.old } else { reload.new })
    }
}

/// Reads the file again when it was replaced.
pub(crate) struct ControlWatch {
    path: PathBuf,
    /// Inode and modification time of the file that was read.
    read: Option<(u64, SystemTime)>,
    control: Control,
}

impl ControlWatch {
    pub(crate) fn new(instance: &Instance) -> ControlWatch {
        ControlWatch { path: Control::path(instance), read: None, control: Control::default() }
    }

    /// The current content; the default if there is no file.
    pub(crate) fn look(&mut self) -> &Control {
        let about = std::fs::metadata(&self.path).ok();
        let found = about.and_then(|about| Some((about.ino(), about.modified().ok()?)));
        if found != self.read {
            self.read = found;
            let text = std::fs::read(&self.path).unwrap_or_default();
            self.control = serde_json::from_slice(&text).unwrap_or_default();
        }
        &self.control
    }
}
