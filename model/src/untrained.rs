//! A manifest before training: anchors and thresholds of the public SECOND configurations.

use crate::manifest::{AnchorClass, Beams, Manifest, Provenance, Thresholds};
use crate::network::Network;

/// Height of KITTI's sensor above the ground, m.
const SENSOR_HEIGHT_M: f32 = 1.73;

/// Name; l, w, h in m; matched and unmatched overlap.
type Anchor = (&'static str, [f32; 3], f32, f32);

/// Name; l, w, h in m; matched and unmatched overlap. KITTI's known classes are the first three, UDI's all. Boxes stand
/// on the ground.
const ANCHORS: [Anchor; 4] = [
    ("car", [3.9, 1.6, 1.56], 0.6, 0.45),
    ("pedestrian", [0.8, 0.6, 1.73], 0.5, 0.35),
    ("cyclist", [1.76, 0.6, 1.73], 0.5, 0.35),
    ("truck", [6.93, 2.51, 2.84], 0.55, 0.4),
];

/// Anchors without a class: from a person to a lorry, a guess that covers what moves on a road.
const GENERIC: [Anchor; 4] = [
    ("generic_person", [1.0, 1.0, 1.7], 0.5, 0.35),
    ("generic_cart", [2.5, 1.3, 1.9], 0.5, 0.35),
    ("generic_car", [5.0, 1.9, 2.2], 0.5, 0.35),
    ("generic_truck", [9.0, 2.6, 3.2], 0.5, 0.35),
];

fn standing(anchors: &[Anchor]) -> Vec<AnchorClass> {
    let anchor = |&(name, size_m, matched_iou, unmatched_iou): &Anchor| AnchorClass {
        name: name.into(),
        size_m,
        bottom_z_m: -SENSOR_HEIGHT_M,
        matched_iou,
        unmatched_iou,
    };
    anchors.iter().map(anchor).collect()
}

impl AnchorClass {
    /// The anchor of a class; where the class is none of the usual ones, with a size that the trainer must measure.
    pub fn named(name: &str) -> AnchorClass {
        let mut anchors = standing(&ANCHORS).into_iter();
        let known = anchors.find(|anchor| anchor.name == name);
        known.unwrap_or_else(|| AnchorClass {
            name: name.into(),
            size_m: [4.0, 1.8, 2.0],
            bottom_z_m: -SENSOR_HEIGHT_M,
            matched_iou: 0.5,
            unmatched_iou: 0.35,
        })
    }
}

impl Manifest {
    /// How many sizes of anchors without a class there are.
    pub const GENERIC_ANCHORS: usize = GENERIC.len();

    /// For a network of at most four classes; the trainer replaces what it learns. The gate never fires.
    pub fn untrained(name: &str, network: Network) -> Manifest {
        Manifest {
            format: Manifest::FORMAT,
            name: name.into(),
            prototype_scale: network.head.prototype_scale().unwrap_or(3.0),
            classes: standing(&ANCHORS[..network.classes.min(ANCHORS.len())]),
            generic: standing(&GENERIC[..network.generic.min(GENERIC.len())]),
            network,
            sensor_height_m: SENSOR_HEIGHT_M,
            uses_intensity: true,
            empty_objectness_max: 0.0,
            thresholds: Thresholds {
                objectness_min: 0.1,
                candidates_max: 4096,
                nms_iou: 0.01,
                boxes_max: 500,
                eds_normalised_max: 0.0,
                softmax_min: 0.0,
                unknown_min: 0.0,
                profiles: None,
            },
            beams: Beams::default(),
            takes: None,
            provenance: Provenance::default(),
        }
    }
}
