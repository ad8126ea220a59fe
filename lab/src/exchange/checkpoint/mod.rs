//! Named tensors out of a file: PyTorch's zip archive, its legacy format (before 1.6), or safetensors.

mod archive;
mod legacy;
mod state;
mod values;

use std::collections::BTreeMap;

use mluc_model::Tensor;
use safetensors::tensor::{Dtype, SafeTensors};

use super::ExchangeError;
use super::pickle::Element;

/// Metadata key of our manifest in safetensors.
pub(super) const MANIFEST_KEY: &str = "mluc";

/// What a file holds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Checkpoint {
    /// Weights by their names in the file. Counters and other integers are left out.
    pub tensors: BTreeMap<String, Tensor>,
    /// Our manifest, where `mluc-lab export` wrote the file.
    pub manifest: Option<String>,
}

/// Reads the weights of a file by what its bytes say it is. No code of the file is run.
pub fn read(bytes: &[u8]) -> Result<Checkpoint, ExchangeError> {
    if bytes.starts_with(b"PK\x03\x04") {
        return archive::read(bytes);
    }
    if bytes.starts_with(&legacy::MAGIC) {
        return legacy::read(bytes);
    }
    // Eight bytes of length, then JSON.
    if bytes.get(8) == Some(&b'{') {
        return read_safetensors(bytes);
    }
    Err(ExchangeError::Unknown {
        bytes: bytes.len(),
        head: bytes[..bytes.len().min(8)].to_vec(),
    })
}

fn read_safetensors(bytes: &[u8]) -> Result<Checkpoint, ExchangeError> {
    let damaged = |cause: safetensors::SafeTensorError| ExchangeError::Container {
        cause: cause.to_string(),
    };
    let (_, header) = SafeTensors::read_metadata(bytes).map_err(damaged)?;
    let metadata = header.metadata().as_ref();
    let mut checkpoint = Checkpoint {
        manifest: metadata.and_then(|metadata| metadata.get(MANIFEST_KEY).cloned()),
        ..Checkpoint::default()
    };
    for (name, view) in SafeTensors::deserialize(bytes).map_err(damaged)?.iter() {
        let element = match view.dtype() {
            Dtype::F64 => Element::F64,
            Dtype::F32 => Element::F32,
            Dtype::F16 => Element::F16,
            Dtype::BF16 => Element::Bf16,
            _ => continue,
        };
        let data = values::numbers(view.data(), element);
        let shape = view.shape().to_vec();
        checkpoint
            .tensors
            .insert(name.to_owned(), Tensor { shape, data });
    }
    Ok(checkpoint)
}
