//! A manifest before training: anchors and thresholds of the public SECOND configurations.

use crate::manifest::{AnchorClass, Beams, Manifest, Provenance, Thresholds};
use crate::network::Network;

/// Height of KITTI's sensor above the ground, m.
const SENSOR_HEIGHT_M: f32 = 1.73;

/// Name; l, w, h in m; matched and unmatched overlap. KITTI's known classes are the first three, UDI's all. Boxes stand
/// on the ground.
const ANCHORS: [(&str, [f32; 3], f32, f32); 4] = [
    ("car", [3.9, 1.6, 1.56], 0.6, 0.45),
    ("pedestrian", [0.8, 0.6, 1.73], 0.5, 0.35),
    ("cyclist", [1.76, 0.6, 1.73], 0.5, 0.35),
    ("truck", [6.93, 2.51, 2.84], 0.55, 0.4),
];

impl Manifest {
    /// For a network of at most four classes; the trainer replaces what it learns. The gate never fires.
    pub fn untrained(name: &str, network: Network) -> Manifest {
        let anchors = ANCHORS.iter().take(network.classes);
        let classes = anchors.map(|&(name, size_m, matched_iou, unmatched_iou)| AnchorClass {
            name: name.into(),
            size_m,
            bottom_z_m: -SENSOR_HEIGHT_M,
            matched_iou,
            unmatched_iou,
        });
        Manifest {
            format: Manifest::FORMAT,
            name: name.into(),
            classes: classes.collect(),
            network,
            sensor_height_m: SENSOR_HEIGHT_M,
            uses_intensity: true,
            prototype_scale: 3.0,
            empty_objectness_max: 0.0,
            thresholds: Thresholds {
                objectness_min: 0.1,
                candidates_max: 4096,
                nms_iou: 0.01,
                boxes_max: 500,
                eds_normalised_max: 0.0,
            },
            beams: Beams::default(),
            provenance: Provenance::default(),
        }
    }
}
