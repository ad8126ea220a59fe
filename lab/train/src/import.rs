//! Starts a run from the weights of another network: trunk, and the rows of the heads that mean the same.
//!
//! A head's row is known by what it says (`presence car/0`: the first anchor of `car` holds something), so that a network
//! with other classes or another kind of head takes what it can. The rest keeps its fresh start, and is named.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use mluc_model::{Manifest, Model, WeightSet};

use crate::error::TrainError;
use crate::export::{axes, place};
use crate::layers::Linear;
use crate::trainer::Trainer;

/// The model file of `path`: itself, or that of a run's folder.
pub(crate) fn model_path(path: &Path) -> PathBuf {
    if path.is_dir() {
        path.join("model.safetensors")
    } else {
        path.to_owned()
    }
}

/// Takes what fits into `trainer`; says what it took. `path`: as at [`model_path`].
pub(crate) fn start_from(
    path: &Path,
    manifest: &Manifest,
    trainer: &mut Trainer,
) -> Result<String, TrainError> {
    let path = model_path(path);
    let model = Model::read(&path)?;
    let mut fresh = take_trunk(&model.weights, trainer);
    let taken_layers = trainer.chain.layers().count() - fresh.len();
    let (mut taken, mut rows) = (0, 0);
    let source = HeadRows::of(&model);
    for head in trainer.chain.heads.all() {
        let names = row_names(&head.name, manifest);
        let parameters = &mut trainer.state.parameters;
        let copied = source.copy(head, &names, manifest.prototype_scale, parameters);
        (taken, rows) = (taken + copied, rows + names.len());
        let missing = names.len() - copied;
        if missing > 0 {
            fresh.push(format!(
                "{missing} of {} rows of {}",
                names.len(),
                head.name
            ));
        }
    }
    if taken_layers + taken == 0 {
        let expected = "layers or head rows of the network to be trained";
        return Err(TrainError::refused(&path, expected, "none"));
    }
    if fresh.is_empty() {
        fresh.push("nothing".to_owned());
    }
    Ok(format!(
        "{}: took {taken_layers} layers and {taken} of {rows} rows of the heads; fresh: {}",
        path.display(),
        fresh.join(", ")
    ))
}

/// Copies the layers of the same name and shape; returns the names of the others.
fn take_trunk(weights: &WeightSet, trainer: &mut Trainer) -> Vec<String> {
    let (chain, state) = (&trainer.chain, &mut trainer.state);
    let mut fresh = vec![];
    for layer in chain.layers() {
        let tensor = |part: &str, count: usize| {
            let found = weights.find(&format!("{}.{part}", layer.name));
            found.map(|t| &t.data).filter(|data| data.len() == count)
        };
        let parts = ["bn.weight", "bn.bias", "bn.running_mean", "bn.running_var"];
        let norm = parts.map(|part| tensor(part, layer.channels));
        let ([Some(gamma), Some(beta), Some(mean), Some(variance)], Some(weight)) =
            (norm, tensor("weight", layer.weight.len()))
        else {
            fresh.push(layer.name.clone());
            continue;
        };
        let axes = axes(chain, layer);
        let plain = &mut state.parameters[layer.weight.clone()];
        for (i, value) in weight.iter().enumerate() {
            plain[place(axes, i)] = *value;
        }
        state.parameters[layer.gamma.clone()].copy_from_slice(gamma);
        state.parameters[layer.beta.clone()].copy_from_slice(beta);
        state.running[layer.norm].mean.clone_from(mean);
        state.running[layer.norm].var.clone_from(variance);
    }
    fresh
}

/// What each row of a head says.
fn row_names(head: &str, manifest: &Manifest) -> Vec<String> {
    let classes: Vec<&str> = manifest.classes.iter().map(|c| c.name.as_str()).collect();
    let agnostic = manifest.generic.iter().map(|c| c.name.as_str());
    let owners = classes.iter().copied().chain(agnostic);
    let anchors = owners.flat_map(|own| [0, 1].map(|r| (own, format!("{own}/{r}"))));
    let of_class = |own: &str, anchor: &str, class: &str| {
        if class == own {
            format!("presence {anchor}")
        } else {
            format!("presence {anchor} as {class}")
        }
    };
    let rows = |(own, anchor): (&str, String)| -> Vec<String> {
        let parts = |prefix: &str, count: usize| {
            let part = |i: usize| format!("{prefix} {anchor} {i}");
            (0..count).map(part).collect()
        };
        match head {
            "head.objectness" => vec![format!("presence {anchor}")],
            "head.class" => {
                let names = classes.iter().map(|class| of_class(own, &anchor, class));
                names.collect()
            }
            "head.box" => parts("box", 7),
            _ => parts("direction", 2),
        }
    };
    match head {
        "head.embedding" => classes.iter().map(|c| format!("embedding {c}")).collect(),
        "head.unknown" => vec![head.to_owned()],
        _ => anchors.flat_map(rows).collect(),
    }
}

/// The rows of a model's heads by what they say.
struct HeadRows<'a> {
    model: &'a Model,
    /// Head and number.
    rows: BTreeMap<String, (&'static str, usize)>,
}

impl HeadRows<'_> {
    fn of(model: &Model) -> HeadRows<'_> {
        let mut rows = BTreeMap::new();
        for (head, _) in model.manifest.network.heads() {
            let names = row_names(head, &model.manifest).into_iter().enumerate();
            rows.extend(names.map(|(i, name)| (name, (head, i))));
        }
        HeadRows { model, rows }
    }

    /// Copies the rows of these names; returns how many there were. Embeddings are scaled so that their probabilities stay:
    /// those depend on T f alone.
    fn copy(&self, head: &Linear, names: &[String], scale: f32, parameters: &mut [f32]) -> usize {
        let (manifest, weights) = (&self.model.manifest, &self.model.weights);
        if head.cin != manifest.network.feature_channels() {
            return 0;
        }
        let mut copied = 0;
        for (row, name) in names.iter().enumerate() {
            let Some(&(from, number)) = self.rows.get(name) else {
                continue;
            };
            let is_embedding = from == "head.embedding";
            let ratio = manifest.prototype_scale / scale;
            let factor = if is_embedding { ratio } else { 1.0 };
            let tensor = |part: &str| weights.find(&format!("{from}.{part}"));
            let (Some(weight), Some(bias)) = (tensor("weight"), tensor("bias")) else {
                continue;
            };
            for c in 0..head.cin {
                parameters[head.weight.start + c * head.cout + row] =
                    factor * weight.data[number * head.cin + c];
            }
            parameters[head.bias.start + row] = factor * bias.data[number];
            copied += 1;
        }
        copied
    }
}
