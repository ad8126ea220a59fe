//! Saves and restores a run, exactly: a resumed run gives the bits of an uninterrupted one.
//!
//! A safetensors file: `parameters`, Adam's moments, and the running statistics one after another; its metadata holds
//! the steps and the settings. The batches of a step depend on the seed and the step alone, so no random state is kept.

use std::collections::HashMap;
use std::path::Path;

use safetensors::tensor::{Dtype, SafeTensors, TensorView};

use super::error::TrainError;
use super::trainer::State;
use crate::whole_file::write_whole;

/// Writes a file of the run: a crash or a full disk leaves the old one.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<(), TrainError> {
    write_whole(path, bytes).map_err(|cause| TrainError::Io {
        path: path.to_owned(),
        cause,
    })
}

/// Saves.
pub fn save(path: &Path, state: &State, fingerprint: &str) -> Result<(), TrainError> {
    let flat = |f: fn(&super::norm::Statistics) -> &Vec<f32>| -> Vec<f32> {
        state
            .running
            .iter()
            .flat_map(|s| f(s).iter().copied())
            .collect()
    };
    let (means, variances) = (flat(|s| &s.mean), flat(|s| &s.variance));
    let lists: [(&str, &[f32]); 5] = [
        ("parameters", &state.parameters),
        ("adam.first", &state.adam.first),
        ("adam.second", &state.adam.second),
        ("running.mean", &means),
        ("running.variance", &variances),
    ];
    let broken = |cause: safetensors::SafeTensorError| TrainError::Checkpoint {
        path: path.to_owned(),
        expected: "tensors that can be written".into(),
        found: cause.to_string(),
    };
    let (mut buffers, mut views) = (vec![], vec![]);
    for (name, list) in lists {
        let bytes: Vec<u8> = list.iter().flat_map(|v| v.to_le_bytes()).collect();
        buffers.push((name, list.len(), bytes));
    }
    for (name, len, bytes) in &buffers {
        views.push((
            *name,
            TensorView::new(Dtype::F32, vec![*len], bytes).map_err(broken)?,
        ));
    }
    let metadata = HashMap::from([
        ("step".to_owned(), state.step.to_string()),
        ("adam.steps".to_owned(), state.adam.steps.to_string()),
        (
            "adam.momentum_product".to_owned(),
            state.adam.momentum_product.to_bits().to_string(),
        ),
        ("settings".to_owned(), fingerprint.to_owned()),
    ]);
    let bytes = safetensors::serialize(views, Some(metadata)).map_err(broken)?;
    write_atomically(path, &bytes)
}

/// Restores into a state of the same shapes; false when there is no checkpoint.
pub fn load(path: &Path, state: &mut State, fingerprint: &str) -> Result<bool, TrainError> {
    let wrong = |expected: &str, found: String| TrainError::Checkpoint {
        path: path.to_owned(),
        expected: expected.to_owned(),
        found,
    };
    let bytes = match std::fs::read(path) {
        Ok(bytes) => bytes,
        Err(cause) if cause.kind() == std::io::ErrorKind::NotFound => return Ok(false),
        Err(cause) => {
            return Err(TrainError::Io {
                path: path.to_owned(),
                cause,
            });
        }
    };
    let not_one = |cause: safetensors::SafeTensorError| wrong("a checkpoint", cause.to_string());
    let (_, header) = SafeTensors::read_metadata(&bytes).map_err(not_one)?;
    let tensors = SafeTensors::deserialize(&bytes).map_err(not_one)?;
    let metadata = header.metadata().clone().unwrap_or_default();
    let text = |name: &str| metadata.get(name).cloned().unwrap_or_default();
    if text("settings") != fingerprint {
        return Err(wrong(
            &format!("a run with '{fingerprint}'"),
            format!("'{}'", text("settings")),
        ));
    }
    let number = |name: &str| -> Result<u64, TrainError> {
        text(name)
            .parse()
            .map_err(|_| wrong(&format!("a whole number in {name}"), text(name)))
    };
    let list = |name: &str, count: usize| -> Result<Vec<f32>, TrainError> {
        let tensor = tensors.tensor(name).map_err(not_one)?;
        if tensor.dtype() != Dtype::F32 || tensor.data().len() != 4 * count {
            return Err(wrong(
                &format!("{name} of {count} f32"),
                format!("{} bytes", tensor.data().len()),
            ));
        }
        let values = tensor.data().chunks_exact(4);
        let values: Vec<f32> = values
            .map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]))
            .collect();
        match values.iter().find(|v| !v.is_finite()) {
            Some(found) => Err(wrong(
                &format!("finite values in {name}"),
                found.to_string(),
            )),
            None => Ok(values),
        }
    };
    let count = state.parameters.len();
    let mut restored = state.clone();
    restored.parameters = list("parameters", count)?;
    restored.adam.first = list("adam.first", count)?;
    restored.adam.second = list("adam.second", count)?;
    restored.adam.steps = number("adam.steps")?;
    restored.adam.momentum_product = f64::from_bits(number("adam.momentum_product")?);
    restored.step = number("step")?;
    let channels = state.running.iter().map(|s| s.mean.len()).sum();
    let (means, variances) = (
        list("running.mean", channels)?,
        list("running.variance", channels)?,
    );
    let mut at = 0;
    for statistics in &mut restored.running {
        let range = at..at + statistics.mean.len();
        at = range.end;
        statistics.mean.copy_from_slice(&means[range.clone()]);
        statistics.variance.copy_from_slice(&variances[range]);
    }
    *state = restored;
    Ok(true)
}
