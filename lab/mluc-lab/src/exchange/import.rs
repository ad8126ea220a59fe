//! A checkpoint as a model file with a closed-set head.

use super::{checkpoint, checkpoint::Checkpoint, names::is_unchanged, names::tensor_names};
use anyhow::{Context, bail};
use mluc_head::Head;
use mluc_model::{AnchorClass, Grid, HeadKind, Manifest, Network, Tensor, WeightSet};
use mluc_train::export::empty_objectness_max;

/// A model that passes every check.
#[derive(Clone, Debug, PartialEq)]
pub struct Imported {
    /// Manifest with a closed-set head, or the manifest of an exported model.
    pub manifest: Manifest,
    /// Weights under our names.
    pub weights: WeightSet,
    /// Layout of the sparse layers in the file.
    pub layout: SparseLayout,
}

/// The anchor of a class in OpenPCDet's SECOND configurations, with its bottom on KITTI (`anchors.json`).
pub fn anchor(class: &str) -> anyhow::Result<AnchorClass> {
    let anchors: Vec<AnchorClass> = serde_json::from_str(include_str!("anchors.json"))?;
    let known = anchors.into_iter().find(|anchor| anchor.name == class);
    known.with_context(|| {
        format!(
            "class {class}: expected its anchor (name=length,width,height,bottom in m), found none"
        )
    })
}

/// SECOND on KITTI's grid with these classes, in the order of the checkpoint's configuration.
pub fn second(name: &str, classes: Vec<AnchorClass>) -> Manifest {
    let network =
        Network { head: HeadKind::Sigmoid, ..Network::second(Grid::kitti_second(), classes.len()) };
    let mut manifest = Manifest::untrained(name, network);
    manifest.classes = classes;
    manifest.provenance.data = "imported from a checkpoint of OpenPCDet".into();
    manifest
}

/// Reads a checkpoint of SECOND, or a file of [`super::export()`]; the latter has its own manifest, and `second` is ignored.
pub fn import(bytes: &[u8], second: Manifest) -> anyhow::Result<Imported> {
    let checkpoint = checkpoint::read(bytes)?;
    let Some(json) = &checkpoint.manifest else {
        let mut imported = fill(second, checkpoint)?;
        let (manifest, weights) = (&imported.manifest, &imported.weights);
        imported.manifest.empty_objectness_max = empty_objectness_max(manifest, weights)?;
        // Rejects a network that detects objects in an empty scan.
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
    let is_kept = |name: &String, _: &mut _| is_unchanged(&manifest.network, name);
    for (name, kept) in checkpoint.tensors.extract_if(.., is_kept) {
        weights.insert(name, kept.shape, kept.data);
    }
    let mut others = checkpoint.tensors.keys();
    if let Some(tensor) = others.next() {
        let others = match others.len() {
            0 => String::new(),
            count => format!(" and {count} more"),
        };
        bail!("tensor `{tensor}`{others}: expected a layer of SECOND, found none of that name");
    }
    let sparse = found.iter().filter_map(|(.., shape, t)| Some((five(shape)?, t.shape.clone())));
    let layout = SparseLayout::of(&sparse.collect::<Vec<_>>());
    for (ours, theirs, shape, tensor) in found {
        let tensor = fitted(&theirs, &shape, tensor, layout)?;
        weights.insert(ours, tensor.shape, tensor.data);
    }
    weights.check(&manifest.network)?;
    Ok(Imported {
        manifest,
        weights,
        // Without a layout a sparse layer was rejected above.
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
    let found = tensor.shape;
    bail!("tensor `{name}`: expected shape {expected}, found {found:?}")
}

/// The order of axes of a sparse convolution's weights. It differs between versions of spconv, and a file does not state it. Layers with
/// different numbers of input and output channels show it. (z, y, x) are the taps of the kernel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SparseLayout {
    /// spconv 2: (out, z, y, x, in), which is also ours.
    OutTapsIn,
    /// spconv 1: (z, y, x, in, out).
    TapsInOut,
    /// spconv 2 with its native algorithm: (z, y, x, out, in).
    TapsOutIn,
}

impl SparseLayout {
    /// Every supported layout, the most likely first.
    pub const ALL: [SparseLayout; 3] = [Self::OutTapsIn, Self::TapsInOut, Self::TapsOutIn];

    /// The shape in this layout of a tensor with shape `ours`.
    pub fn shape(self, [out, z, y, x, cin]: [usize; 5]) -> [usize; 5] {
        match self {
            SparseLayout::OutTapsIn => [out, z, y, x, cin],
            SparseLayout::TapsInOut => [z, y, x, cin, out],
            SparseLayout::TapsOutIn => [z, y, x, out, cin],
        }
    }

    /// The first layout that fits every layer: pairs of our shape and the shape found.
    pub fn of(layers: &[([usize; 5], Vec<usize>)]) -> Option<SparseLayout> {
        let fits = |layout: &SparseLayout| {
            layers.iter().all(|(ours, found)| layout.shape(*ours)[..] == found[..])
        };
        SparseLayout::ALL.into_iter().find(fits)
    }

    /// Converts from this layout to ours, (out, z, y, x, in). `tensor` has [`SparseLayout::shape`] of `ours`.
    pub fn to_ours(self, tensor: &Tensor, ours: [usize; 5]) -> Tensor {
        let [out, z, y, x, cin] = ours;
        let taps = z * y * x;
        let at = |o: usize, tap: usize, i: usize| match self {
            SparseLayout::OutTapsIn => (o * taps + tap) * cin + i,
            SparseLayout::TapsInOut => (tap * cin + i) * out + o,
            SparseLayout::TapsOutIn => (tap * out + o) * cin + i,
        };
        let places = (0..out * taps * cin).map(|n| at(n / cin / taps, n / cin % taps, n % cin));
        Tensor { shape: ours.to_vec(), data: places.map(|place| tensor.data[place]).collect() }
    }
}
