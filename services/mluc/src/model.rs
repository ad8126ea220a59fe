//! Finding a model: built into this program, by name, or a file.

use crate::{UsageError, document::nearest, settings::Settings};
use anyhow::Context;
use mluc_model::{HeadKind, Model};
use mluc_runtime::Instance;
use serde::{Deserialize, Serialize};
use std::{fs, path::Path, path::PathBuf};

macro_rules! built_in {
    ($($name:literal),+) => {
        &[$(($name, include_bytes!(concat!("../../../weights/", $name, ".safetensors")))),+]
    };
}
/// The models in this program, from `weights/`. A new model needs its name here and its baselines in `tests/tests/accuracy.toml`.
const BUILT_IN: &[(&str, &[u8])] = built_in!("any-open", "any");
/// The models of the paper's settings: files in `weights/paper/` of the repository.
const PAPER: [&str; 4] = ["kitti", "kitti-open", "udi", "udi-open"];

pub(crate) fn built_in(name: &str) -> Option<&'static [u8]> {
    BUILT_IN.iter().find_map(|(own, bytes)| (*own == name).then_some(*bytes))
}

/// Loads and checks a model. A built-in name wins over a file of that name; `./any-open` is always a file.
pub fn load(name: &str) -> anyhow::Result<Model> {
    if let Some(bytes) = built_in(name) {
        return Model::from_bytes(bytes).with_context(|| format!("built-in model '{name}'"));
    }
    let path = Path::new(name);
    if !path.is_file() {
        let names: Vec<&str> = BUILT_IN.iter().map(|&(name, _)| name).collect();
        let known = names.join(", ");
        let paper = PAPER.contains(&name).then(|| {
            format!("; the paper's models are files of the repository: --model weights/paper/{name}.safetensors")
        });
        let near = || nearest(name, names).map(|near| format!("; did you mean '{near}'?"));
        let hint = paper.or_else(near).unwrap_or_default();
        let text = format!("model '{name}': no such file; built in: {known}{hint}");
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
            "lambda: expected a model whose gate is the EDS (the paper's head), found '{name}', whose gate is --unknown-min"
        ));
    }
    if settings.unknown_min.is_some() && !is_open {
        return refused(format!(
            "unknown_min: expected a model with a logit of the unknown (an -open model), found '{name}', whose gate is --lambda"
        ));
    }
    let has_gate = model.manifest.network.head != HeadKind::Sigmoid;
    if settings.lambda.is_some_and(|lambda| lambda > 0.0) && !has_gate {
        return refused(format!(
            "lambda: expected a model with a metric head, or 0, found '{name}', a closed-set detector"
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

/// The copies that a start removes: more than the reloads of a run.
const COPIES_MAX: u64 = 999;

/// A copy of a run's model for the stages, in its own folder in the instance's folder: it stays, whatever happens to the model's file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct PinnedModel {
    pub(crate) fingerprint: u64,
    pub(crate) file: PathBuf,
}

impl PinnedModel {
    fn folder(instance: &Instance, number: u64) -> PathBuf {
        instance.root().join(format!("model-{number}"))
    }

    /// Removes a copy, or a part of one: an incomplete copy would take up the rest of shared memory.
    pub(crate) fn remove(instance: &Instance, number: u64) {
        let _ = fs::remove_dir_all(PinnedModel::folder(instance, number));
    }

    /// `number`: unique among the copies of the run. From now on the settings name the copy.
    pub(crate) fn new(settings: &mut Settings, model: &Model, number: u64) -> anyhow::Result<Self> {
        let (name, fingerprint) = (&settings.model, model.fingerprint);
        let bytes = built_in(name).map_or_else(|| fs::read(name), |bytes| Ok(bytes.to_vec()));
        // Earlier supervisors may have left copies, with reports from stages that are still alive.
        let last = if number == 0 { COPIES_MAX } else { number };
        (number..=last).for_each(|number| PinnedModel::remove(&settings.instance, number));
        let folder = PinnedModel::folder(&settings.instance, number);
        let file = folder.join("model.safetensors");
        let made = fs::create_dir_all(folder).and(bytes);
        let copied = made.and_then(|bytes| fs::write(&file, bytes));
        copied.with_context(|| format!("copying model '{name}' to {}", file.display()))?;
        settings.model = file.to_string_lossy().into_owned();
        Ok(PinnedModel { fingerprint, file })
    }
}
