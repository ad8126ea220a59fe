//! What OpenPCDet calls each tensor of SECOND (`VoxelBackBone8x`, `BaseBEVBackbone`, `AnchorHeadSingle`).
//!
//! Its modules are lists of modules, so a name counts places: in a block of the bird's-eye part, padding, convolution,
//! normalisation and ReLU of layer `i` stand at places 0, 1 + 3 i, 2 + 3 i and 3 + 3 i.

use std::collections::HashMap;

use mluc_model::{Network, expected_tensors};

/// Convolution and normalisation of a layer.
struct Place {
    convolution: String,
    norm: String,
}

impl Place {
    fn new(module: &str, convolution: usize) -> Place {
        Place {
            convolution: format!("{module}.{convolution}"),
            norm: format!("{module}.{}", convolution + 1),
        }
    }
}

fn places(network: &Network) -> HashMap<&str, Place> {
    let mut places = HashMap::new();
    for layer in &network.sparse {
        let name = layer.name.as_str();
        let module = name.strip_prefix("backbone3d.").unwrap_or(name);
        places.insert(name, Place::new(&format!("backbone_3d.{module}"), 0));
    }
    for (block, layers) in [&network.block1, &network.block2].into_iter().enumerate() {
        for (number, layer) in layers.iter().enumerate() {
            let module = format!("backbone_2d.blocks.{block}");
            places.insert(&layer.name, Place::new(&module, 1 + 3 * number));
        }
    }
    for (number, layer) in [&network.up1, &network.up2].into_iter().enumerate() {
        let module = format!("backbone_2d.deblocks.{number}");
        places.insert(&layer.name, Place::new(&module, 0));
    }
    places
}

/// Our name of a head's tensor as OpenPCDet has it; heads that it does not have are named alike.
fn head_name(ours: &str) -> String {
    let (head, part) = ours.rsplit_once('.').unwrap_or((ours, ""));
    let convolution = match head {
        "head.class" => "conv_cls",
        "head.box" => "conv_box",
        "head.direction" => "conv_dir_cls",
        "head.objectness" => "conv_objectness",
        "head.embedding" => "conv_embedding",
        "head.unknown" => "conv_unknown",
        other => other,
    };
    format!("dense_head.{convolution}.{part}")
}

fn name_of(places: &HashMap<&str, Place>, ours: &str) -> String {
    let split = ours.rsplit_once('.').map(|(layer, part)| {
        let norm = layer.strip_suffix(".bn");
        (norm.unwrap_or(layer), norm.is_some(), part)
    });
    match split.and_then(|(layer, norm, part)| Some((places.get(layer)?, norm, part))) {
        Some((place, true, part)) => format!("{}.{part}", place.norm),
        Some((place, false, part)) => format!("{}.{part}", place.convolution),
        None => head_name(ours),
    }
}

/// OpenPCDet's name of one of our tensors.
pub fn openpcdet_name(network: &Network, ours: &str) -> String {
    name_of(&places(network), ours)
}

/// Ours, OpenPCDet's and the shape of every tensor of a network, in the order of its layers.
pub fn tensor_names(network: &Network) -> Vec<(String, String, Vec<usize>)> {
    let places = places(network);
    let tensors = expected_tensors(network).into_iter();
    tensors
        .map(|(ours, shape)| {
            let theirs = name_of(&places, &ours);
            (ours, theirs, shape)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use mluc_model::Grid;
    use std::collections::HashSet;

    #[test]
    fn names_are_those_of_the_public_modules() {
        let network = Network::second(Grid::kitti_second(), 3);
        for (ours, theirs) in [
            (
                "backbone3d.conv_input.weight",
                "backbone_3d.conv_input.0.weight",
            ),
            ("backbone3d.conv1.0.bn.bias", "backbone_3d.conv1.0.1.bias"),
            ("backbone3d.conv4.2.weight", "backbone_3d.conv4.2.0.weight"),
            (
                "backbone3d.conv_out.bn.running_var",
                "backbone_3d.conv_out.1.running_var",
            ),
            (
                "backbone2d.block1.0.weight",
                "backbone_2d.blocks.0.1.weight",
            ),
            (
                "backbone2d.block2.5.bn.weight",
                "backbone_2d.blocks.1.17.weight",
            ),
            ("backbone2d.up2.weight", "backbone_2d.deblocks.1.0.weight"),
            (
                "backbone2d.up1.bn.running_mean",
                "backbone_2d.deblocks.0.1.running_mean",
            ),
            ("head.class.bias", "dense_head.conv_cls.bias"),
            ("head.direction.weight", "dense_head.conv_dir_cls.weight"),
        ] {
            assert_eq!(openpcdet_name(&network, ours), theirs);
        }
    }

    #[test]
    fn no_two_tensors_share_a_name() {
        for network in [
            Network::second(Grid::kitti_second(), 3),
            Network::compact(Grid::udi(), 4).with_reach_of_trucks(),
        ] {
            let names = tensor_names(&network);
            let theirs: HashSet<_> = names.iter().map(|(_, theirs, _)| theirs).collect();
            assert_eq!(theirs.len(), names.len());
        }
    }
}
