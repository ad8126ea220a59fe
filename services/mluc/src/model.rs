//! Finding a model: embedded in this binary by name, or a file.

use std::path::Path;

use anyhow::Context;
use mluc_model::{HeadKind, Model};

use crate::names::hint;
use crate::settings::Settings;
use crate::{UsageError, embedded};

/// Whether this binary holds a model of that name.
pub(crate) fn is_embedded(name: &str) -> bool {
    bytes_of(name).is_some()
}

fn bytes_of(name: &str) -> Option<&'static [u8]> {
    let mut models = embedded::MODELS.iter();
    models.find_map(|(embedded, bytes)| (*embedded == name).then_some(*bytes))
}

/// Loads and checks a model. A name wins over a file of that name; `./kitti` is always a file.
pub fn load(name: &str) -> anyhow::Result<Model> {
    if let Some(bytes) = bytes_of(name) {
        return Model::from_bytes(bytes).with_context(|| format!("embedded model '{name}'"));
    }
    let path = Path::new(name);
    if !path.exists() {
        let names: Vec<&str> = embedded::MODELS.iter().map(|&(name, _)| name).collect();
        let known = if names.is_empty() {
            "this build has none embedded".to_string()
        } else {
            format!("embedded are: {}", names.join(", "))
        };
        return Err(UsageError(format!(
            "model '{name}': no such file, and no embedded model of that name ({known}){}",
            hint(name, names)
        ))
        .into());
    }
    Ok(Model::read(path)?)
}

/// The model of a run, with the gate's threshold that the user wants.
pub fn load_for(settings: &Settings) -> anyhow::Result<Model> {
    let mut model = load(&settings.model)?;
    let is_open = model.manifest.network.head == HeadKind::Open;
    let name = &settings.model;
    let thresholds = &mut model.manifest.thresholds;
    match (settings.lambda, settings.unknown_min) {
        (Some(_), _) if is_open => Err(UsageError(format!(
            "lambda: expected a model whose gate is the EDS (udi, kitti), found '{name}', whose gate is --unknown-min"
        ))
        .into()),
        (_, Some(_)) if !is_open => Err(UsageError(format!(
            "unknown_min: expected a model with a logit of the unknown (udi-open, kitti-open), found '{name}', whose gate is --lambda"
        ))
        .into()),
        (lambda, unknown_min) => {
            if let Some(lambda) = lambda {
                thresholds.eds_normalised_max = lambda as f32;
            }
            if let Some(unknown_min) = unknown_min {
                thresholds.unknown_min = unknown_min as f32;
            }
            Ok(model)
        }
    }
}

/// Names of the classes, in the order of class ids.
pub fn class_names(model: &Model) -> Vec<String> {
    let classes = model.manifest.classes.iter();
    classes.map(|class| class.name.clone()).collect()
}
