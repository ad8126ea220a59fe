//! Finding a model: embedded in this binary by name, or a file.

use std::path::Path;

use anyhow::Context;
use mluc_model::{HeadKind, Model};

use crate::document::nearest;
use crate::settings::Settings;
use crate::{UsageError, embedded};

pub(crate) fn embedded(name: &str) -> Option<&'static [u8]> {
    let mut models = embedded::MODELS.iter();
    models.find_map(|(own, bytes)| (*own == name).then_some(*bytes))
}

/// Loads and checks a model. A name wins over a file of that name; `./kitti` is always a file.
pub fn load(name: &str) -> anyhow::Result<Model> {
    if let Some(bytes) = embedded(name) {
        return Model::from_bytes(bytes).with_context(|| format!("embedded model '{name}'"));
    }
    let path = Path::new(name);
    if !path.exists() {
        let names: Vec<&str> = embedded::MODELS.iter().map(|&(name, _)| name).collect();
        let known = match names[..] {
            [] => "this build has none embedded".to_string(),
            _ => format!("embedded are: {}", names.join(", ")),
        };
        let hint = nearest(name, names).map(|near| format!("; did you mean '{near}'?"));
        let hint = hint.unwrap_or_default();
        let text = format!(
            "model '{name}': no such file, and no embedded model of that name ({known}){hint}"
        );
        return Err(UsageError(text).into());
    }
    Ok(Model::read(path)?)
}

/// The model of a run, with the gate's threshold that the user wants.
pub(crate) fn load_for(settings: &Settings) -> anyhow::Result<Model> {
    let mut model = load(&settings.model)?;
    let is_open = model.manifest.network.head == HeadKind::Open;
    let name = &settings.model;
    let refused = |text: String| Err(UsageError(text).into());
    if settings.lambda.is_some() && is_open {
        return refused(format!(
            "lambda: expected a model whose gate is the EDS (udi, kitti), found '{name}', whose gate is --unknown-min"
        ));
    }
    if settings.unknown_min.is_some() && !is_open {
        return refused(format!(
            "unknown_min: expected a model with a logit of the unknown (an -open model), found '{name}', whose gate is --lambda"
        ));
    }
    let thresholds = &mut model.manifest.thresholds;
    if let Some(lambda) = settings.lambda {
        thresholds.eds_normalised_max = lambda as f32;
    }
    if let Some(unknown_min) = settings.unknown_min {
        thresholds.unknown_min = unknown_min as f32;
    }
    Ok(model)
}

/// Names of the classes, in the order of class ids.
pub fn class_names(model: &Model) -> Vec<String> {
    let classes = model.manifest.classes.iter();
    classes.map(|class| class.name.clone()).collect()
}
