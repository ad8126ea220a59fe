//! A model as safetensors with OpenPCDet's names (`docs/weights.md`).

use std::collections::HashMap;

use mluc_model::{Model, WeightSet};

use super::ExchangeError;
use super::checkpoint::MANIFEST_KEY;
use super::names::{tensor_names, unchanged_names};

/// The bytes of the file. Its metadata holds the manifest, so that [`super::import()`] gives the same model again, and
/// `format: pt`, which PyTorch's readers of safetensors ask for.
pub fn export(model: &Model) -> Result<Vec<u8>, ExchangeError> {
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
    let metadata = HashMap::from([
        (
            MANIFEST_KEY.to_owned(),
            serde_json::to_string(&model.manifest)?,
        ),
        ("format".to_owned(), "pt".to_owned()),
    ]);
    safetensors::serialize(renamed.iter(), Some(metadata)).map_err(ExchangeError::Written)
}
