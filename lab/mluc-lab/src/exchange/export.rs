//! A model as safetensors with OpenPCDet's names (`docs/weights.md`).

use std::collections::HashMap;

use anyhow::Context;
use mluc_model::{Model, WeightSet};

use super::checkpoint::MANIFEST_KEY;
use super::names::{tensor_names, unchanged_names};

/// The bytes of the file. Its metadata holds the manifest, so that [`super::import()`] gives the same model again, and
/// `format: pt`, which PyTorch's readers of safetensors ask for.
pub fn export(model: &Model) -> anyhow::Result<Vec<u8>> {
    let mut renamed = WeightSet::new();
    let network = &model.manifest.network;
    for (ours, theirs, shape) in tensor_names(network) {
        let data = model.weights.get(&ours, &shape)?.to_vec();
        renamed.insert(theirs, shape, data);
    }
    for name in unchanged_names(network) {
        if let Some(kept) = model.weights.find(&name) {
            renamed.insert(name, kept.shape.clone(), kept.data.clone());
        }
    }
    let manifest = serde_json::to_string(&model.manifest).context("the manifest")?;
    let metadata = [(MANIFEST_KEY, manifest), ("format", "pt".to_owned())];
    let metadata = HashMap::from(metadata.map(|(key, value)| (key.to_owned(), value)));
    let file = safetensors::serialize(renamed.iter(), Some(metadata));
    file.context("the safetensors cannot be made")
}
