//! Exchange of weights: checkpoints of OpenPCDet's SECOND become model files, and model files become safetensors with
//! OpenPCDet's names of the layers (`docs/weights.md` lists them).
//!
//! A checkpoint is a safetensors file. PyTorch's own files contain a pickle, a program that may call anything:
//! `tools/checkpoint_to_safetensors.py` converts them with PyTorch's restricted reader.

mod checkpoint;
mod import;
mod names;

pub use import::{Imported, SparseLayout, anchor, import, second};
pub use names::{openpcdet_name, tensor_names};

use anyhow::Context;
use checkpoint::MANIFEST_KEY;
use mluc_model::{Model, WeightSet};
use names::is_unchanged;
use std::collections::HashMap;

/// The bytes of a model as such a file. Its metadata contains the manifest, so that [`import()`] restores the same model, and
/// `format: pt`, which PyTorch's readers of safetensors require.
pub fn export(model: &Model) -> anyhow::Result<Vec<u8>> {
    let mut renamed = WeightSet::new();
    let network = &model.manifest.network;
    for (ours, theirs, shape) in tensor_names(network) {
        let data = model.weights.get(&ours, &shape)?.to_vec();
        renamed.insert(theirs, shape, data);
    }
    for (name, kept) in model.weights.iter() {
        if is_unchanged(network, name) {
            renamed.insert(name.to_owned(), kept.shape.clone(), kept.data.clone());
        }
    }
    let manifest = serde_json::to_string(&model.manifest).context("the manifest")?;
    let metadata = [(MANIFEST_KEY, manifest), ("format", "pt".to_owned())];
    let metadata = HashMap::from(metadata.map(|(key, value)| (key.to_owned(), value)));
    safetensors::serialize(renamed.iter(), Some(metadata)).context("the safetensors cannot be made")
}
