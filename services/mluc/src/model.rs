//! Finding a model: embedded in this binary by name, or a file.

use std::path::Path;

use anyhow::{Context, bail};
use mluc_model::{HeadKind, Model};

use crate::UsageError;
use crate::embedded;
use crate::settings::Settings;

/// Loads and checks a model. A name wins over a file of that name; `./kitti` is always a file.
pub(crate) fn load(name: &str) -> anyhow::Result<Model> {
    if let Some((_, bytes)) = embedded::MODELS
        .iter()
        .find(|(embedded, _)| *embedded == name)
    {
        return Model::from_bytes(bytes).with_context(|| format!("embedded model '{name}'"));
    }
    let path = Path::new(name);
    if !path.exists() {
        let names: Vec<&str> = embedded::MODELS.iter().map(|&(name, _)| name).collect();
        let known = match names.is_empty() {
            true => "this build has none embedded".to_string(),
            false => format!("embedded are: {}", names.join(", ")),
        };
        bail!("model '{name}': no such file, and no embedded model of that name ({known})");
    }
    Ok(Model::read(path)?)
}

/// The model of a run, with the gate's thresholds that the user wants.
pub(crate) fn load_for(settings: &Settings) -> anyhow::Result<Model> {
    let mut model = load(&settings.model)?;
    let thresholds = &mut model.manifest.thresholds;
    if let Some(lambda) = settings.lambda {
        thresholds.eds_normalised_max = lambda;
    }
    if let Some(p) = settings.unknown_min {
        if model.manifest.network.head != HeadKind::Open {
            let error = format!(
                "unknown_min: expected a model with a logit of the unknown (udi-open, kitti-open), found '{}', whose gate is --lambda",
                settings.model
            );
            return Err(UsageError(error).into());
        }
        thresholds.unknown_min = p;
    }
    Ok(model)
}

/// Names of the classes, in the order of class ids.
pub(crate) fn class_names(model: &Model) -> Vec<String> {
    model
        .manifest
        .classes
        .iter()
        .map(|class| class.name.clone())
        .collect()
}
