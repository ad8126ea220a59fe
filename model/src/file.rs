//! The model file: safetensors with the manifest as JSON in its metadata.

use std::borrow::Cow;
use std::collections::HashMap;
use std::path::Path;

use safetensors::tensor::{Dtype, SafeTensors, View};

use crate::error::ModelError;
use crate::manifest::Manifest;
use crate::tensors::{Tensor, WeightSet};

/// Metadata key of the manifest.
const MANIFEST_KEY: &str = "mluc";

/// A model that passed every check.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    /// What it was trained for.
    pub manifest: Manifest,
    /// Every tensor of its network.
    pub weights: WeightSet,
    /// FNV-1a of the file's bytes: tells two models apart.
    pub fingerprint: u64,
}

impl Model {
    /// Reads and checks a model file's bytes.
    pub fn from_bytes(bytes: &[u8]) -> Result<Model, ModelError> {
        let damaged = |cause: safetensors::SafeTensorError| ModelError::Container {
            bytes: bytes.len(),
            cause: cause.to_string(),
        };
        let (_, header) = SafeTensors::read_metadata(bytes).map_err(damaged)?;
        let metadata = header
            .metadata()
            .as_ref()
            .and_then(|metadata| metadata.get(MANIFEST_KEY));
        let manifest =
            read_manifest(metadata.ok_or(ModelError::NoManifest { key: MANIFEST_KEY })?)?;
        let mut weights = WeightSet::new();
        for (name, view) in SafeTensors::deserialize(bytes).map_err(damaged)?.iter() {
            if view.dtype() != Dtype::F32 {
                let found = format!("{:?}", view.dtype());
                return Err(ModelError::TensorType {
                    tensor: name.into(),
                    found,
                });
            }
            let values = view
                .data()
                .chunks_exact(4)
                .map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]));
            weights.insert(name, view.shape().to_vec(), values.collect());
        }
        weights.check(&manifest.network)?;
        Ok(Model {
            manifest,
            weights,
            fingerprint: fingerprint(bytes),
        })
    }

    /// Reads and checks a model file.
    pub fn read(path: &Path) -> Result<Model, ModelError> {
        let bytes = std::fs::read(path).map_err(|cause| ModelError::Io {
            path: path.into(),
            cause,
        })?;
        Model::from_bytes(&bytes).map_err(|cause| ModelError::InFile {
            path: path.into(),
            cause: Box::new(cause),
        })
    }
}

/// The bytes of a model file; the same model gives the same bytes. Refuses what [`Model::from_bytes`] would refuse.
pub fn model_bytes(manifest: &Manifest, weights: &WeightSet) -> Result<Vec<u8>, ModelError> {
    manifest.validate()?;
    weights.check(&manifest.network)?;
    let json = serde_json::to_string(manifest).map_err(|cause| ModelError::ManifestSyntax {
        cause: cause.to_string(),
    })?;
    let metadata = HashMap::from([(MANIFEST_KEY.to_string(), json)]);
    safetensors::serialize(weights.iter(), Some(metadata)).map_err(|cause| ModelError::Container {
        bytes: 0,
        cause: cause.to_string(),
    })
}

impl View for &Tensor {
    fn dtype(&self) -> Dtype {
        Dtype::F32
    }
    fn shape(&self) -> &[usize] {
        &self.shape
    }
    fn data(&self) -> Cow<'_, [u8]> {
        self.data
            .iter()
            .flat_map(|value| value.to_le_bytes())
            .collect()
    }
    fn data_len(&self) -> usize {
        self.data.len() * 4
    }
}

/// The format version first: another version's fields would only give a misleading message.
fn read_manifest(json: &str) -> Result<Manifest, ModelError> {
    let syntax = |cause: serde_json::Error| ModelError::ManifestSyntax {
        cause: cause.to_string(),
    };
    let loose: serde_json::Value = serde_json::from_str(json).map_err(syntax)?;
    let format = loose.get("format");
    if format.and_then(serde_json::Value::as_u64) != Some(u64::from(Manifest::FORMAT)) {
        let found = format.map_or("none".into(), ToString::to_string);
        return Err(ModelError::Format {
            expected: Manifest::FORMAT,
            found,
        });
    }
    let manifest: Manifest = serde_json::from_str(json).map_err(syntax)?;
    manifest.validate()?;
    Ok(manifest)
}

fn fingerprint(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xCBF2_9CE4_8422_2325, |hash, byte| {
        (hash ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01B3)
    })
}
