//! A checkpoint as a model file with a closed-set head.

use anyhow::{Context, bail};
use mluc_backbone::Backbone;
use mluc_head::Head;
use mluc_model::{AnchorClass, Grid, HeadKind, Manifest, Network, Tensor, WeightSet};

use super::SparseLayout;
use super::checkpoint::{self, Checkpoint};
use super::names::{tensor_names, unchanged_names};

/// A model that passes every check.
#[derive(Clone, Debug, PartialEq)]
pub struct Imported {
    /// Closed set, or that of an exported model.
    pub manifest: Manifest,
    /// Under our names.
    pub weights: WeightSet,
    /// Layout of the sparse layers in the file.
    pub layout: SparseLayout,
}

/// Anchors of OpenPCDet's SECOND configurations: name; l, w, h; z of the bottom on KITTI, m; matched and unmatched overlap.
const ANCHORS: [(&str, [f32; 3], f32, [f32; 2]); 5] = [
    ("car", [3.9, 1.6, 1.56], -1.78, [0.6, 0.45]),
    ("pedestrian", [0.8, 0.6, 1.73], -0.6, [0.5, 0.35]),
    ("cyclist", [1.76, 0.6, 1.73], -0.6, [0.5, 0.35]),
    ("van", [5.07, 1.9, 2.21], -1.78, [0.6, 0.45]),
    ("truck", [10.13, 2.58, 3.25], -1.78, [0.55, 0.4]),
];

/// The anchor that OpenPCDet's configurations give a class.
pub fn anchor(class: &str) -> anyhow::Result<AnchorClass> {
    let known = ANCHORS.into_iter().find(|(name, ..)| *name == class);
    let (name, size_m, bottom_z_m, [matched_iou, unmatched_iou]) = known.with_context(|| {
        format!(
            "class {class}: expected its anchor (name=length,width,height,bottom in m), found none"
        )
    })?;
    Ok(AnchorClass {
        name: name.into(),
        size_m,
        bottom_z_m,
        matched_iou,
        unmatched_iou,
    })
}

/// SECOND on KITTI's grid with these classes, in the order of the checkpoint's configuration.
pub fn second(name: &str, classes: Vec<AnchorClass>) -> Manifest {
    let network = Network {
        head: HeadKind::Sigmoid,
        ..Network::second(Grid::kitti_second(), classes.len())
    };
    let mut manifest = Manifest::untrained(name, network);
    manifest.classes = classes;
    manifest.provenance.data = "imported from a checkpoint of OpenPCDet".into();
    manifest
}

/// Reads a checkpoint of SECOND, or what [`super::export()`] wrote; the latter brings its own manifest, and `second` does
/// not count.
pub fn import(bytes: &[u8], second: Manifest) -> anyhow::Result<Imported> {
    let checkpoint = checkpoint::read(bytes)?;
    let Some(json) = &checkpoint.manifest else {
        let mut imported = fill(second, checkpoint)?;
        imported.manifest.empty_objectness_max = empty_score(&imported)?;
        // Refuses a network that sees things where nothing is.
        Head::new(&imported.manifest, &imported.weights)?;
        return Ok(imported);
    };
    let manifest = serde_json::from_str(json).context("the manifest in the file's metadata")?;
    fill(manifest, checkpoint)
}

fn fill(manifest: Manifest, mut checkpoint: Checkpoint) -> anyhow::Result<Imported> {
    manifest.validate()?;
    let classes = manifest.network.classes;
    let mut found = vec![];
    for (ours, theirs, shape) in tensor_names(&manifest.network) {
        let tensor = checkpoint.tensors.remove(&theirs).with_context(|| {
            format!(
                "tensor `{theirs}` of shape {shape:?} is missing: is the checkpoint of SECOND with {classes} classes?"
            )
        })?;
        found.push((ours, theirs, shape, tensor));
    }
    let mut weights = WeightSet::new();
    for name in unchanged_names(&manifest.network) {
        if let Some(kept) = checkpoint.tensors.remove(&name) {
            weights.insert(name, kept.shape, kept.data);
        }
    }
    let mut others = checkpoint.tensors.keys();
    if let Some(tensor) = others.next() {
        let others = match others.len() {
            0 => String::new(),
            count => format!(" and {count} more"),
        };
        bail!("tensor `{tensor}`{others}: expected a layer of SECOND, found none of that name");
    }
    let sparse: Vec<_> = found
        .iter()
        .filter_map(|(.., shape, tensor)| Some((five(shape)?, tensor.shape.clone())))
        .collect();
    let layout = SparseLayout::of(&sparse);
    for (ours, theirs, shape, tensor) in found {
        let tensor = fitted(&theirs, &shape, tensor, layout)?;
        weights.insert(ours, tensor.shape, tensor.data);
    }
    weights.check(&manifest.network)?;
    Ok(Imported {
        manifest,
        weights,
        // Without one a sparse layer was refused above.
        layout: layout.unwrap_or(SparseLayout::OutTapsIn),
    })
}

/// The shape of a sparse layer's weights; no other tensor has five axes.
fn five(shape: &[usize]) -> Option<[usize; 5]> {
    shape.try_into().ok()
}

fn fitted(
    name: &str,
    shape: &[usize],
    tensor: Tensor,
    layout: Option<SparseLayout>,
) -> anyhow::Result<Tensor> {
    let expected = match (five(shape), layout) {
        (None, _) if tensor.shape == shape => return Ok(tensor),
        (None, _) => format!("{shape:?}"),
        (Some(ours), Some(layout)) => return Ok(layout.to_ours(&tensor, ours)),
        (Some(ours), None) => format!(
            "{:?}, every sparse layer in the same of these orders",
            SparseLayout::ALL.map(|layout| layout.shape(ours))
        ),
    };
    bail!(
        "tensor `{name}`: expected shape {expected}, found {:?}",
        tensor.shape
    )
}

/// The largest score of a scan without points.
fn empty_score(imported: &Imported) -> anyhow::Result<f32> {
    let rows = Backbone::new(&imported.manifest, &imported.weights)?.empty_rows()?;
    Ok(Head::new(&imported.manifest, &imported.weights)?.objectness_max(&rows))
}
