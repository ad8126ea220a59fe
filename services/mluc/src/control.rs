//! What the supervisor tells ingest while a run is on: a file in the instance's folder, read before each scan.

use std::collections::BTreeSet;
use std::path::PathBuf;

use anyhow::Context;
use mluc_runtime::Instance;
use serde::{Deserialize, Serialize};

#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Control {
    /// Indices of scans that kill stages: an empty frame takes the place of each.
    pub(crate) set_aside: BTreeSet<u64>,
    /// Pace `complete`: no next frame yet.
    pub(crate) holds: bool,
}

impl Control {
    fn path(instance: &Instance) -> PathBuf {
        instance.root().join("control.json")
    }

    /// Appears as a whole.
    pub(crate) fn write(&self, instance: &Instance) -> anyhow::Result<()> {
        let path = Control::path(instance);
        let new = path.with_extension("new");
        let text = serde_json::to_vec(self)?;
        let written = std::fs::write(&new, text).and_then(|()| std::fs::rename(&new, &path));
        written.with_context(|| format!("writing {}", path.display()))
    }

    /// Nothing was said: no scan is set aside.
    pub(crate) fn read(instance: &Instance) -> Control {
        let text = std::fs::read(Control::path(instance)).unwrap_or_default();
        serde_json::from_slice(&text).unwrap_or_default()
    }
}
