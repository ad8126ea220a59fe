//! Writes a step for another program: raw little-endian numbers, and a description of their shapes.
//!
//! `step.json` has the layers with the places of their numbers in `parameters` (and `gradients`); `gather.N.bin` is layer
//! N's list of input rows (outputs x taps, `u32::MAX` where there is none).

use std::path::Path;

use anyhow::Result;
use bytemuck::NoUninit;
use mluc_bench::save;
use mluc_model::DenseLayer;
use mluc_train::layers::{Layer, Linear};
use mluc_train::network::{Chain, Outputs, Pass};
use serde_json::{Value, json};

use crate::work::{Work, scatter_of};

pub(crate) fn write(work: &mut Work, folder: &Path) -> Result<()> {
    let (pass, _) = work.run();
    let plan = &work.plan;
    let (cells, levels): (Vec<u32>, Vec<u32>) = scatter_of(&plan.map).into_iter().unzip();
    put(folder, "parameters", &work.parameters)?;
    put(folder, "voxels", &plan.sparse.voxels)?;
    for (number, layer) in plan.sparse.layers.iter().enumerate() {
        put(folder, &format!("gather.{number}"), &layer.gather.index)?;
    }
    put(folder, "cells", &cells)?;
    put(folder, "levels", &levels)?;
    put(folder, "labelled", &work.labelled)?;
    put(folder, "presence_gradient", &work.presence_gradient)?;
    let gradient = side_by_side(work, &work.outputs);
    put(folder, "labelled_gradient", &gradient)?;
    put(folder, "presence", &presence(work, &pass))?;
    let answers = side_by_side(work, &pass.outputs);
    put(folder, "labelled_outputs", &answers)?;
    put(folder, "gradients", &work.pool.gradients)?;
    save(folder, "step.json", description(work).to_string())
}

fn put<T: NoUninit>(folder: &Path, name: &str, values: &[T]) -> Result<()> {
    let bytes = bytemuck::cast_slice::<T, u8>(values);
    save(folder, &format!("{name}.bin"), bytes)
}

/// Rows of several heads as one.
fn side_by_side(work: &Work, outputs: &Outputs) -> Vec<f32> {
    let parts = [&outputs.embedding, &outputs.boxes, &outputs.direction];
    let count = work.labelled.len();
    let mut rows = vec![];
    for row in 0..count {
        for part in parts {
            let width = part.len() / count;
            rows.extend_from_slice(&part[row * width..][..width]);
        }
    }
    rows
}

/// The logits of every cell.
fn presence(work: &Work, pass: &Pass) -> Vec<f32> {
    let (map, anchors) = (&work.plan.map, work.chain.heads.presence.cout);
    let [first, second] = &pass.outputs.presence;
    let rows = map.up1_row.iter().zip(&map.up2_row);
    rows.flat_map(|(row1, row2)| {
        let [row1, row2] = [*row1, *row2].map(|row| row as usize * anchors);
        (0..anchors).map(move |a| first[row1 + a] + second[row2 + a])
    })
    .collect()
}

fn description(work: &Work) -> Value {
    let chain = &work.chain;
    let Chain { network, heads, .. } = chain;
    let plain = |layers: &[Layer]| -> Value { layers.iter().map(|l| layer(l, 1)).collect() };
    let block = |layers: &[Layer], like: &[DenseLayer]| -> Value {
        let pairs = layers.iter().zip(like);
        pairs.map(|(l, d)| layer(l, d.stride)).collect()
    };
    let presence = [&heads.presence].into_iter().chain(&heads.embedding);
    let heads = presence.chain([&heads.boxes, &heads.direction]).map(head);
    json!({
        "shape": work.plan.map.shape,
        "map_channels": network.map_channels(),
        "epsilon": mluc_train::norm::EPSILON,
        "sparse": plain(&chain.sparse),
        "block1": block(&chain.block1, &network.block1),
        "block2": block(&chain.block2, &network.block2),
        "up1": layer(&chain.up1, 1),
        "up2": layer(&chain.up2, 1),
        "heads": heads.collect::<Vec<_>>(),
    })
}

fn layer(layer: &Layer, stride: usize) -> Value {
    json!({
        "name": layer.name, "taps": layer.taps, "cin": layer.cin, "cout": layer.cout,
        "channels": layer.channels, "stride": stride, "weight": layer.weight.start,
        "gamma": layer.gamma.start, "beta": layer.beta.start,
    })
}

fn head(head: &Linear) -> Value {
    json!({
        "name": head.name, "cin": head.cin, "cout": head.cout,
        "weight": head.weight.start, "bias": head.bias.start,
    })
}
