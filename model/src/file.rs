//! The model file: safetensors with the manifest as JSON in its metadata.

use crate::tensors::{Tensor, WeightSet};
use crate::{error::ModelError, error::Result, manifest::Manifest};
use mluc_geometry::{FNV_OFFSET, fnv1a};
use safetensors::SafeTensorError;
use safetensors::tensor::{Dtype, SafeTensors, View};
use std::{borrow::Cow, collections::HashMap, path::Path};

/// Metadata key of the manifest.
const MANIFEST_KEY: &str = "mluc";

/// A model that passed every check.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    /// What the model was trained for.
    pub manifest: Manifest,
    /// Every tensor of its network.
    pub weights: WeightSet,
    /// FNV-1a of the file's bytes: distinguishes two models.
    pub fingerprint: u64,
}

impl Model {
    /// Reads and checks a model file's bytes.
    pub fn from_bytes(bytes: &[u8]) -> Result<Model> {
        let (metadata, weights) = read_tensors(bytes)?;
        let missing = || format!("has no manifest (metadata key `{MANIFEST_KEY}`)");
        let manifest = metadata.get(MANIFEST_KEY);
        let manifest = read_manifest(manifest.ok_or_else(|| ModelError::File(missing()))?)?;
        weights.check(&manifest.network)?;
        Ok(Model { manifest, weights, fingerprint: fnv1a(FNV_OFFSET, bytes) })
    }

    /// Reads and checks a model file.
    pub fn read(path: &Path) -> Result<Model> {
        let bytes = std::fs::read(path).map_err(|cause| ModelError::Io(path.into(), cause))?;
        Model::from_bytes(&bytes).map_err(|cause| ModelError::InFile(path.into(), cause.into()))
    }
}

/// Metadata and tensors of a safetensors file, with any names; each tensor must be f32.
pub fn read_tensors(bytes: &[u8]) -> Result<(HashMap<String, String>, WeightSet)> {
    let damaged = |cause: SafeTensorError| {
        let length = bytes.len();
        let cause = format!(
            "of {length} bytes is damaged, cut short or no safetensors file: {cause} (checkpoints of other programs: docs/weights.md)"
        );
        ModelError::File(cause)
    };
    let (_, header) = SafeTensors::read_metadata(bytes).map_err(damaged)?;
    let mut weights = WeightSet::new();
    for (name, view) in SafeTensors::deserialize(bytes).map_err(damaged)?.iter() {
        if view.dtype() != Dtype::F32 {
            let cause = format!("must hold F32, found {:?}", view.dtype());
            return Err(ModelError::tensor(name, cause));
        }
        let (values, _) = view.data().as_chunks();
        let values = values.iter().map(|bytes| f32::from_le_bytes(*bytes));
        weights.insert(name, view.shape().to_vec(), values.collect());
    }
    Ok((header.metadata().clone().unwrap_or_default(), weights))
}

/// The bytes of a model file; the same model gives the same bytes. Refuses a model that [`Model::from_bytes`] would refuse.
pub fn model_bytes(manifest: &Manifest, weights: &WeightSet) -> Result<Vec<u8>> {
    manifest.validate()?;
    weights.check(&manifest.network)?;
    let metadata = HashMap::from([(MANIFEST_KEY.to_string(), serde_json::to_string(manifest)?)]);
    safetensors::serialize(weights.iter(), Some(metadata))
        .map_err(|cause| ModelError::File(format!("cannot be written: {cause}")))
}

impl View for &Tensor {
    fn dtype(&self) -> Dtype {
        Dtype::F32
    }
    fn shape(&self) -> &[usize] {
        &self.shape
    }
    fn data(&self) -> Cow<'_, [u8]> {
        self.data.iter().flat_map(|value| value.to_le_bytes()).collect()
    }
    fn data_len(&self) -> usize {
        self.data.len() * 4
    }
}

/// Checks the format version first: an error about another version's fields would mislead.
fn read_manifest(json: &str) -> Result<Manifest> {
    let loose: serde_json::Value = serde_json::from_str(json)?;
    let (format, expected) = (&loose["format"], Manifest::FORMAT);
    if *format != expected {
        let found = format.to_string().replace("null", "none");
        return Err(ModelError::File(format!(
            "has format {found}, this program reads format {expected}: train it again or convert it"
        )));
    }
    let manifest: Manifest = serde_json::from_str(json)?;
    manifest.validate()?;
    Ok(manifest)
}
