//! OpenPCDet's name of each tensor of SECOND (`VoxelBackBone8x`, `BaseBEVBackbone`, `AnchorHeadSingle`).
//!
//! Its modules are lists of modules, so a name contains indices: in a block of the bird's-eye part, padding, convolution,
//! normalisation and ReLU of layer `i` have the indices 0, 1 + 3 i, 2 + 3 i and 3 + 3 i.

use mluc_model::{BASELINE, CLUSTER_SCORER, Network, calibrated_layers};
use mluc_model::{calibration_tensor, expected_tensors};

/// OpenPCDet's name of one of our tensors; heads that it does not have are named in the same way.
pub fn openpcdet_name(ours: &str) -> String {
    let (layer, part) = ours.rsplit_once('.').unwrap_or((ours, ""));
    let (layer, norm) = layer.strip_suffix(".bn").map_or((layer, 0), |layer| (layer, 1));
    if let Some(module) = layer.strip_prefix("backbone3d.") {
        return format!("backbone_3d.{module}.{norm}.{part}");
    }
    if let Some((block, index)) = in_block(layer) {
        let place = 1 + 3 * index + norm;
        return format!("backbone_2d.blocks.{}.{place}.{part}", block - 1);
    }
    let module = match layer {
        "backbone2d.up1" => return format!("backbone_2d.deblocks.0.{norm}.{part}"),
        "backbone2d.up2" => return format!("backbone_2d.deblocks.1.{norm}.{part}"),
        "head.class" => "conv_cls",
        "head.box" => "conv_box",
        "head.direction" => "conv_dir_cls",
        "head.objectness" => "conv_objectness",
        "head.embedding" => "conv_embedding",
        "head.unknown" => "conv_unknown",
        other => other,
    };
    format!("dense_head.{module}.{part}")
}

/// Block (from 1) and layer (from 0) of `backbone2d.blockB.i`.
fn in_block(layer: &str) -> Option<(usize, usize)> {
    let (block, index) = layer.strip_prefix("backbone2d.block")?.split_once('.')?;
    Some((block.parse().ok()?, index.parse().ok()?))
}

/// Our name, OpenPCDet's name and the shape of every tensor of a network, in the order of its layers.
pub fn tensor_names(network: &Network) -> Vec<(String, String, Vec<usize>)> {
    let tensors = expected_tensors(network).into_iter();
    let named = tensors.map(|(ours, shape)| {
        let theirs = openpcdet_name(&ours);
        (ours, theirs, shape)
    });
    named.collect()
}

/// Whether an optional tensor keeps our name: a calibration range, the cluster scorer or a part of a baseline.
pub(super) fn is_unchanged(network: &Network, name: &str) -> bool {
    let is_range = |(level, _): &(String, _)| name == calibration_tensor(level);
    name == CLUSTER_SCORER
        || name.starts_with(BASELINE)
        || calibrated_layers(network).iter().any(is_range)
}
