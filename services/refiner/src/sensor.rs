//! What the refiner must know about the model and its sensor.

use mluc_model::{Beams, HeadKind, Manifest};

/// The sensor as the model was trained for it.
#[derive(Clone, Debug, PartialEq)]
pub struct Sensor {
    /// Height above the ground, m.
    pub height_m: f64,
    /// Beams for the range image; `None`: neighbours are found by distance.
    pub beams: Option<Beams>,
    /// Names of the known classes, in the order of `class_id`.
    pub classes: Vec<String>,
    /// Whether the model also sees behind the vehicle.
    pub sees_all_around: bool,
    /// Whether the detections have a probability of being none of the known classes (the model has an open head).
    pub tells_unknown: bool,
}

impl Sensor {
    /// A sensor without a beam table, 1.73 m above the ground, all around.
    pub fn plain(classes: &[&str]) -> Sensor {
        Sensor {
            height_m: 1.73,
            beams: None,
            classes: classes.iter().map(|name| name.to_string()).collect(),
            sees_all_around: true,
            tells_unknown: false,
        }
    }

    /// From a model file's manifest.
    pub fn from_manifest(manifest: &Manifest) -> Sensor {
        let beams = Some(manifest.beams.clone());
        Sensor {
            height_m: f64::from(manifest.sensor_height_m),
            beams: beams.filter(|beams| !beams.elevation_rad.is_empty()),
            classes: manifest.class_names(),
            sees_all_around: manifest.network.grid.range_min_m[0] < 0.0,
            tells_unknown: manifest.network.head == HeadKind::Open,
        }
    }
}
