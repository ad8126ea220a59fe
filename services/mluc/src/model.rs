//! Finding a model: embedded in this binary by name, or a file.

use std::path::Path;

use anyhow::{Context, bail};
use mluc_model::Model;

use crate::embedded;

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
    Model::read(path).with_context(|| format!("model {name}"))
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
