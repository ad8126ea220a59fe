//! A manifest before training: anchors and thresholds of the public SECOND configurations, listed in `untrained.json`.

use crate::manifest::{AnchorClass, Beams, Manifest, Provenance, Thresholds};
use crate::network::Network;
use serde::Deserialize;

/// Height of KITTI's sensor above the ground, m, on which the boxes stand.
const SENSOR_HEIGHT_M: f32 = 1.73;

#[derive(Deserialize)]
struct Tables {
    /// Anchors of the known classes: KITTI's are the first three, UDI's are all.
    anchors: Vec<AnchorClass>,
    /// Anchor of any other class; the trainer must measure its size.
    other: AnchorClass,
    /// Class-agnostic anchors, from a person to a lorry: a guess that covers the objects that move on a road.
    generic: Vec<AnchorClass>,
    /// Thresholds with which the gate never fires.
    thresholds: Thresholds,
}

fn tables() -> Tables {
    serde_json::from_str(include_str!("untrained.json")).expect("the tables of anchors")
}

impl AnchorClass {
    /// The anchor of a class. For a class that is not in the table, the trainer must measure the size.
    pub fn named(name: &str) -> AnchorClass {
        let Tables { anchors, other, .. } = tables();
        let known = anchors.into_iter().find(|anchor| anchor.name == name);
        let name = name.into();
        known.unwrap_or(AnchorClass { name, ..other })
    }
}

impl Manifest {
    /// Number of sizes of class-agnostic anchors.
    pub const GENERIC_ANCHORS: usize = 4;

    /// A manifest for a network of at most four classes; the trainer replaces the values that it learns. The gate never fires.
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
