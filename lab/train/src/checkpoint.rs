//! Saves and restores a run exactly: a resumed run gives the same bits as an uninterrupted one.
//!
//! A safetensors file: `parameters`, Adam's moments, and the running statistics one after another; its metadata contains
//! the steps and the settings. The batches of a step depend only on the seed and the step, so no random state is stored.

use crate::{
    error::{TrainError, refused},
    run_folder,
    trainer::TrainState,
};
use mluc_model::{ModelError, WeightSet, read_tensors};
use safetensors::SafeTensorError;
use std::{collections::HashMap, fmt::Display, path::Path};

/// The error for a file that is no checkpoint, or a checkpoint of another run.
pub(crate) fn wrong(path: &Path, expected: impl Display, found: impl Display) -> TrainError {
    let found = format!("{found}; move it away to start anew");
    refused(path, expected, found)
}

/// Saves a state.
pub fn save(path: &Path, state: &TrainState, fingerprint: &str) -> Result<(), TrainError> {
    let broken = |cause: SafeTensorError| wrong(path, "tensors that can be written", cause);
    let adam = &state.adam;
    let means: Vec<f32> = state.running.iter().flat_map(|s| s.mean.clone()).collect();
    let variances: Vec<f32> = state.running.iter().flat_map(|s| s.var.clone()).collect();
    let mut tensors = WeightSet::new();
    for (name, values) in [
        ("parameters", &state.parameters),
        ("adam.first", &adam.first),
        ("adam.second", &adam.second),
        ("running.mean", &means),
        ("running.variance", &variances),
    ] {
        tensors.insert(name, vec![values.len()], values.clone());
    }
    let momentum_product = adam.momentum_product.to_bits().to_string();
    let metadata = [
        ("step", state.step.to_string()),
        ("adam.steps", adam.steps.to_string()),
        ("adam.momentum_product", momentum_product),
        ("settings", fingerprint.to_owned()),
    ];
    let metadata = HashMap::from(metadata.map(|(name, value)| (name.to_owned(), value)));
    let bytes = safetensors::serialize(tensors.iter(), Some(metadata)).map_err(broken)?;
    run_folder::write(path, &bytes)
}

/// Restores into a state of the same shapes; false where there is no checkpoint.
pub fn load(path: &Path, state: &mut TrainState, fingerprint: &str) -> Result<bool, TrainError> {
    let bytes = match std::fs::read(path) {
        Ok(bytes) => bytes,
        Err(cause) if cause.kind() == std::io::ErrorKind::NotFound => return Ok(false),
        Err(cause) => return Err(TrainError::file(path, cause)),
    };
    let not_one = |cause: ModelError| wrong(path, "a checkpoint of this network", cause);
    let (metadata, tensors) = read_tensors(&bytes).map_err(not_one)?;
    let text = |name: &str| metadata.get(name).map_or("", String::as_str);
    let number = |name: &str| {
        let fault = |_| wrong(path, format!("a whole number in {name}"), text(name));
        text(name).parse::<u64>().map_err(fault)
    };
    let list = |name: &str, to: &mut [f32]| {
        to.copy_from_slice(tensors.get(name, &[to.len()]).map_err(not_one)?);
        match to.iter().find(|value| !value.is_finite()) {
            Some(value) => Err(wrong(path, format!("finite values in {name}"), value)),
            None => Ok(()),
        }
    };
    let found = text("settings");
    if found != fingerprint {
        let only = |text: &str, other: &str| {
            let words = text.split(", ").filter(|word| other.split(", ").all(|own| own != *word));
            words.collect::<Vec<_>>().join(", ")
        };
        let expected = format!("a run with '{}'", only(fingerprint, found));
        let found = format!("'{}'", only(found, fingerprint));
        return Err(wrong(path, expected, found));
    }
    let mut restored = state.clone();
    let adam = &mut restored.adam;
    list("parameters", &mut restored.parameters)?;
    list("adam.first", &mut adam.first)?;
    list("adam.second", &mut adam.second)?;
    adam.steps = number("adam.steps")?;
    adam.momentum_product = f64::from_bits(number("adam.momentum_product")?);
    restored.step = number("step")?;
    let channels = state.running.iter().map(|s| s.mean.len()).sum();
    let (mut means, mut variances) = (vec![0.0; channels], vec![0.0; channels]);
    list("running.mean", &mut means)?;
    list("running.variance", &mut variances)?;
    let (mut means, mut variances) = (means.into_iter(), variances.into_iter());
    for statistics in &mut restored.running {
        let means = statistics.mean.iter_mut().zip(&mut means);
        let variances = statistics.var.iter_mut().zip(&mut variances);
        means.chain(variances).for_each(|(to, from)| *to = from);
    }
    *state = restored;
    Ok(true)
}
