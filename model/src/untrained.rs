//! A manifest before training: anchors and thresholds of the public SECOND configurations, as `untrained.json` lists them.

use serde::Deserialize;

use crate::manifest::{AnchorClass, Beams, Manifest, Provenance, Thresholds};
use crate::network::Network;

/// Height of KITTI's sensor above the ground, m: the boxes stand there.
const SENSOR_HEIGHT_M: f32 = 1.73;

#[derive(Deserialize)]
struct Tables {
    /// KITTI's known classes are the first three, UDI's all.
    anchors: Vec<AnchorClass>,
    /// Of a class that is none of these, with a size that the trainer must measure.
    other: AnchorClass,
    /// Without a class: from a person to a lorry, a guess that covers what moves on a road.
    generic: Vec<AnchorClass>,
    /// The gate never fires.
    thresholds: Thresholds,
}

fn tables() -> Tables {
    serde_json::from_str(include_str!("untrained.json")).expect("the tables of anchors")
}

impl AnchorClass {
    /// The anchor of a class; where the class is none of the usual ones, with a size that the trainer must measure.
    pub fn named(name: &str) -> AnchorClass {
        let Tables { anchors, other, .. } = tables();
        let known = anchors.into_iter().find(|anchor| anchor.name == name);
        let name = name.into();
        known.unwrap_or(AnchorClass { name, ..other })
    }
}

impl Manifest {
    /// How many sizes of anchors without a class there are.
    pub const GENERIC_ANCHORS: usize = 4;

    /// For a network of at most four classes; the trainer replaces what it learns. The gate never fires.
    pub fn untrained(name: &str, network: Network) -> Manifest {
        let mut tables = tables();
        tables.anchors.truncate(network.classes);
        tables.generic.truncate(network.generic);
        Manifest {
            format: Manifest::FORMAT,
            name: name.into(),
            prototype_scale: network.head.prototype_scale().unwrap_or(3.0),
            classes: tables.anchors,
            generic: tables.generic,
            network,
            sensor_height_m: SENSOR_HEIGHT_M,
            uses_intensity: true,
            empty_objectness_max: 0.0,
            thresholds: tables.thresholds,
            beams: Beams::default(),
            takes: None,
            provenance: Provenance::default(),
        }
    }
}
