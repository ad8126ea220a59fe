//! Starts a run from the weights of another network: trunk, and the rows of the heads that mean the same.
//!
//! A head's row is known by what it says (`presence car/0`: the first anchor of `car` holds something), so that a network
//! with other classes or another kind of head takes what it can. The rest keeps its fresh start, and is named.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use mluc_model::{Manifest, Model, WeightSet};

use super::error::TrainError;
use super::export::{orders, place};
use super::layers::Linear;
use super::trainer::Trainer;

/// Takes what fits into `trainer`; says what it took. `path`: a model file, or the folder of a run.
pub(super) fn start_from(
    path: &Path,
    manifest: &Manifest,
    trainer: &mut Trainer,
) -> Result<String, TrainError> {
    let path: PathBuf = match path.is_dir() {
        true => path.join("model.safetensors"),
        false => path.to_owned(),
    };
    let model = Model::read(&path)?;
    let mut fresh = trunk(&model.weights, trainer);
    let taken_layers = trainer.chain.layers().count() - fresh.len();
    let (mut taken, mut rows) = (0, 0);
    let source = Rows::of(&model);
    let heads: Vec<Linear> = trainer.chain.heads.all().cloned().collect();
    for head in heads {
        let names = row_names(&head.name, manifest);
        let parameters = &mut trainer.state.parameters;
        let missing =
            names.len() - source.copy(&head, &names, manifest.prototype_scale, parameters);
        (taken, rows) = (taken + names.len() - missing, rows + names.len());
        if missing > 0 {
            fresh.push(format!(
                "{missing} of {} rows of {}",
                names.len(),
                head.name
            ));
        }
    }
    if taken_layers + taken == 0 {
        return Err(TrainError::NothingTaken { path });
    }
    let fresh = if fresh.is_empty() {
        "nothing".into()
    } else {
        fresh.join(", ")
    };
    Ok(format!(
        "{}: took {taken_layers} layers and {taken} of {rows} rows of the heads; fresh: {fresh}",
        path.display()
    ))
}

/// Copies the layers of the same name and shape; gives the names of the others.
fn trunk(weights: &WeightSet, trainer: &mut Trainer) -> Vec<String> {
    let chain = trainer.chain.clone();
    let state = &mut trainer.state;
    let mut fresh = vec![];
    for (layer, order) in chain.layers().zip(orders(&chain)) {
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
        let plain = &mut state.parameters[layer.weight.clone()];
        for (i, value) in weight.iter().enumerate() {
            plain[place(layer, order, i)] = *value;
        }
        state.parameters[layer.gamma.clone()].copy_from_slice(gamma);
        state.parameters[layer.beta.clone()].copy_from_slice(beta);
        state.running[layer.norm].mean.clone_from(mean);
        state.running[layer.norm].variance.clone_from(variance);
    }
    fresh
}

/// What each row of a head says.
fn row_names(head: &str, manifest: &Manifest) -> Vec<String> {
    let all = manifest.classes.iter().chain(&manifest.generic);
    let anchors: Vec<(String, &str)> = all
        .flat_map(|class| [0, 1].map(|r| (format!("{}/{r}", class.name), class.name.as_str())))
        .collect();
    let each = |prefix: &str, parts: usize| -> Vec<String> {
        let parts = |anchor: &str| -> Vec<String> {
            (0..parts)
                .map(|i| format!("{prefix} {anchor} {i}"))
                .collect()
        };
        anchors
            .iter()
            .flat_map(|(anchor, _)| parts(anchor))
            .collect()
    };
    match head {
        "head.objectness" => anchors
            .iter()
            .map(|(a, _)| format!("presence {a}"))
            .collect(),
        "head.class" => {
            let of = |(anchor, own): &(String, &str)| -> Vec<String> {
                let name = |class: &str| match class == *own {
                    true => format!("presence {anchor}"),
                    false => format!("presence {anchor} as {class}"),
                };
                manifest
                    .classes
                    .iter()
                    .map(|class| name(&class.name))
                    .collect()
            };
            anchors.iter().flat_map(of).collect()
        }
        "head.embedding" => manifest
            .classes
            .iter()
            .map(|c| format!("embedding {}", c.name))
            .collect(),
        "head.box" => each("box", 7),
        "head.direction" => each("direction", 2),
        _ => vec![head.to_owned()],
    }
}

/// The rows of a model's heads by what they say.
struct Rows<'a> {
    weights: &'a WeightSet,
    channels: usize,
    prototype_scale: f32,
    /// Head and number.
    rows: BTreeMap<String, (&'static str, usize)>,
}

impl Rows<'_> {
    fn of(model: &Model) -> Rows<'_> {
        let network = &model.manifest.network;
        let mut rows = BTreeMap::new();
        for (head, _) in network.heads() {
            let names = row_names(head, &model.manifest);
            rows.extend(
                names
                    .into_iter()
                    .enumerate()
                    .map(|(i, name)| (name, (head, i))),
            );
        }
        Rows {
            weights: &model.weights,
            channels: network.feature_channels(),
            prototype_scale: model.manifest.prototype_scale,
            rows,
        }
    }

    /// Copies the rows of these names; gives how many there were. Embeddings are scaled so that their probabilities stay:
    /// those depend on T f alone.
    fn copy(&self, head: &Linear, names: &[String], scale: f32, parameters: &mut [f32]) -> usize {
        if head.cin != self.channels {
            return 0;
        }
        let mut copied = 0;
        for (row, name) in names.iter().enumerate() {
            let Some(&(from, number)) = self.rows.get(name) else {
                continue;
            };
            let factor = match from {
                "head.embedding" => self.prototype_scale / scale,
                _ => 1.0,
            };
            let tensor = |part: &str| self.weights.find(&format!("{from}.{part}"));
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
