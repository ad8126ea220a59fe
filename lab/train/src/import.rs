//! Starts a run from the weights of another network: the trunk, and the rows of the heads with the same meaning.
//!
//! A head's row is identified by its meaning (`presence car/0`: the first anchor of `car` is on an object), so that a network
//! with other classes or another kind of head takes all matching rows. The rest keeps its fresh start, and is reported.

use crate::export::{axes, place};
use crate::{
    error::{TrainError, refused},
    layers::Linear,
    trainer::Trainer,
};
use mluc_model::{AnchorClass, Manifest, Model, WeightSet};
use std::{collections::BTreeMap, path::Path, path::PathBuf};

/// The model file at `path`: the file itself, or the model file in a run's folder.
pub(crate) fn model_path(path: &Path) -> PathBuf {
    if path.is_dir() { path.join("model.safetensors") } else { path.to_owned() }
}

/// Copies all matching weights into `trainer`; returns a report. `path`: as in [`model_path`].
pub(crate) fn start_from(
    path: &Path,
    manifest: &Manifest,
    trainer: &mut Trainer,
) -> Result<String, TrainError> {
    let path = model_path(path);
    let model = Model::read(&path)?;
    let is_alike = model.manifest.network.input == manifest.network.input;
    let mut fresh = take_trunk(&model.weights, trainer, is_alike);
    let taken_layers = trainer.chain.layers().count() - fresh.len();
    let (mut taken, mut rows) = (0, 0);
    let source = rows_of(&model);
    let channels = model.manifest.network.feature_channels();
    let (scale, parameters) = (manifest.prototype_scale, &mut trainer.state.parameters);
    for head in trainer.chain.heads.all() {
        let names = row_names(&head.name, manifest);
        let known = names.iter().enumerate().filter(|_| head.cin == channels);
        let known = known.filter_map(|(row, name)| Some((row, *source.get(name)?)));
        let copy = |(row, from)| copy_row(&model, from, (head, row), scale, parameters);
        let copied = known.map(copy).filter(|is_there| *is_there).count();
        (taken, rows) = (taken + copied, rows + names.len());
        let missing = names.len() - copied;
        if missing > 0 {
            let (all, name) = (names.len(), &head.name);
            fresh.push(format!("{missing} of {all} rows of {name}"));
        }
    }
    if taken_layers + taken == 0 {
        let expected = "layers or head rows of the network to be trained";
        return Err(refused(&path, expected, "none"));
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

/// Copies the layers of the same name and shape; the first layer only where the voxel input is the same. Returns the names of the others.
fn take_trunk(weights: &WeightSet, trainer: &mut Trainer, is_alike: bool) -> Vec<String> {
    let (chain, state) = (&trainer.chain, &mut trainer.state);
    let mut fresh = vec![];
    for (number, layer) in chain.layers().enumerate() {
        let tensor = |part: &str, count: usize| {
            let found = weights.find(&format!("{}.{part}", layer.name));
            let fits = |data: &&Vec<f32>| data.len() == count && (number > 0 || is_alike);
            found.map(|t| &t.data).filter(fits)
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

/// The meaning of each row of a head.
fn row_names(head: &str, manifest: &Manifest) -> Vec<String> {
    let names = |of: &[AnchorClass]| of.iter().map(|c| c.name.clone()).collect::<Vec<_>>();
    let (classes, agnostic) = (names(&manifest.classes), names(&manifest.generic));
    match head {
        "head.embedding" => return classes.iter().map(|c| format!("embedding {c}")).collect(),
        "head.unknown" => return vec![head.to_owned()],
        _ => (),
    }
    let mut rows = vec![];
    let anchors = classes.iter().chain(&agnostic);
    for (own, anchor) in anchors.flat_map(|own| [0, 1].map(|r| (own, format!("{own}/{r}")))) {
        let presence = format!("presence {anchor}");
        match head {
            "head.objectness" => rows.push(presence),
            "head.class" => rows.extend(classes.iter().map(|class| {
                if class == own { presence.clone() } else { format!("{presence} as {class}") }
            })),
            "head.box" => rows.extend((0..7).map(|i| format!("box {anchor} {i}"))),
            _ => rows.extend((0..2).map(|i| format!("direction {anchor} {i}"))),
        }
    }
    rows
}

/// The rows of a model's heads by meaning: head and row number.
fn rows_of(model: &Model) -> BTreeMap<String, (&'static str, usize)> {
    let heads = model.manifest.network.heads().into_iter();
    let rows = heads.flat_map(|(head, _)| {
        let names = row_names(head, &model.manifest).into_iter().enumerate();
        names.map(move |(i, name)| (name, (head, i)))
    });
    rows.collect()
}

/// Copies row `number` of a model's head `from` to row `row` of `head`; returns false where it does not exist. Embeddings are scaled so that
/// their probabilities stay the same: these depend only on T f.
fn copy_row(
    model: &Model,
    (from, number): (&str, usize),
    (head, row): (&Linear, usize),
    prototype_scale: f32,
    parameters: &mut [f32],
) -> bool {
    let tensor = |part: &str| model.weights.find(&format!("{from}.{part}"));
    let (Some(weight), Some(bias)) = (tensor("weight"), tensor("bias")) else {
        return false;
    };
    let is_embedding = from == "head.embedding";
    let ratio = model.manifest.prototype_scale / prototype_scale;
    let factor = if is_embedding { ratio } else { 1.0 };
    let weight = &weight.data[number * head.cin..][..head.cin];
    let to = parameters[head.weight.clone()].iter_mut().skip(row);
    to.step_by(head.cout).zip(weight).for_each(|(to, from)| *to = factor * from);
    parameters[head.bias.start + row] = factor * bias.data[number];
    true
}
