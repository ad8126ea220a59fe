//! Named tensors from a safetensors file.

use anyhow::{Context, ensure};
use half::{bf16, f16};
use mluc_model::Tensor;
use safetensors::tensor::{Dtype, SafeTensors};
use std::collections::BTreeMap;

/// Metadata key of our manifest.
pub(super) const MANIFEST_KEY: &str = "mluc";
/// First bytes of PyTorch's files: a zip archive, or (before PyTorch 1.6) a pickle of protocol 2.
const PYTORCH: [&[u8]; 2] = [b"PK\x03\x04", b"\x80\x02"];

pub(super) struct Checkpoint {
    /// Weights by their names in the file. Counters and other integers are left out.
    pub(super) tensors: BTreeMap<String, Tensor>,
    /// Our manifest, where `mluc-lab export` wrote the file.
    pub(super) manifest: Option<String>,
}

pub(super) fn read(bytes: &[u8]) -> anyhow::Result<Checkpoint> {
    ensure!(
        !PYTORCH.iter().any(|head| bytes.starts_with(head)),
        "expected safetensors, found a PyTorch checkpoint; convert it with \
         `python tools/checkpoint_to_safetensors.py CHECKPOINT.pth CHECKPOINT.safetensors`"
    );
    let count = bytes.len();
    let damaged =
        || format!("expected safetensors, found {count} bytes that are none or are cut short");
    let (_, header) = SafeTensors::read_metadata(bytes).with_context(damaged)?;
    let metadata = header.metadata().as_ref();
    let manifest = metadata.and_then(|metadata| metadata.get(MANIFEST_KEY).cloned());
    let file = SafeTensors::deserialize(bytes).with_context(damaged)?;
    let tensors = file.iter().filter_map(|(name, view)| {
        let data = numbers(view.data(), view.dtype())?;
        let shape = view.shape().to_vec();
        Some((name.to_owned(), Tensor { shape, data }))
    });
    let tensors = tensors.collect();
    Ok(Checkpoint { tensors, manifest })
}

/// Little-endian elements as f32; f64 is rounded. `None` for integers.
fn numbers(bytes: &[u8], element: Dtype) -> Option<Vec<f32>> {
    fn each<const N: usize>(bytes: &[u8], convert: impl Fn([u8; N]) -> f32) -> Vec<f32> {
        bytes.as_chunks::<N>().0.iter().map(|value| convert(*value)).collect()
    }
    match element {
        Dtype::F32 => Some(each(bytes, f32::from_le_bytes)),
        Dtype::F64 => Some(each(bytes, |value| f64::from_le_bytes(value) as f32)),
        Dtype::F16 => Some(each(bytes, |value| f16::from_le_bytes(value).to_f32())),
        Dtype::BF16 => Some(each(bytes, |value| bf16::from_le_bytes(value).to_f32())),
        _ => None,
    }
}
