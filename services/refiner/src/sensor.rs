//! What the refiner must know of the model and its sensor.

use mluc_model::{Beams, HeadKind, Manifest};

use crate::RefinerError;

/// Beams of one range image at most: it bounds the image's memory.
const BEAMS_MAX: usize = 256;
/// Finest azimuth step, rad: 16,384 columns.
const AZIMUTH_STEP_MIN_RAD: f32 = std::f32::consts::TAU / 16_384.0;
/// HDL-64E at 10 Hz, rad (0.1728 degrees); taken where the table gives 0.
const AZIMUTH_STEP_DEFAULT_RAD: f32 = 0.003_015_929;

/// The sensor as the model was trained for it.
#[derive(Clone, Debug, PartialEq)]
pub struct Sensor {
    /// Height above the ground, m.
    pub height_m: f64,
    /// For the range image; `None`: neighbours are found by distance.
    pub beams: Option<Beams>,
    /// Names of the known classes, in the order of `class_id`.
    pub classes: Vec<String>,
    /// Whether the model sees behind the vehicle too.
    pub sees_all_around: bool,
    /// Whether the detections tell a probability of being none of the known (the model's head is an open one).
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

    /// From a model file's manifest. A beam table that is not finite or not descending is refused.
    pub fn from_manifest(manifest: &Manifest) -> Result<Sensor, RefinerError> {
        let mut beams = manifest.beams.clone();
        if beams.azimuth_step_rad == 0.0 {
            beams.azimuth_step_rad = AZIMUTH_STEP_DEFAULT_RAD;
        }
        let beams = Some(beams).filter(|beams| !beams.elevation_rad.is_empty());
        beams.as_ref().map_or(Ok(()), check)?;
        Ok(Sensor {
            height_m: f64::from(manifest.sensor_height_m),
            beams,
            classes: manifest.class_names(),
            sees_all_around: manifest.network.grid.range_min_m[0] < 0.0,
            tells_unknown: manifest.network.head == HeadKind::Open,
        })
    }
}

/// Whether a range image can be made of beams.
pub(crate) fn check(beams: &Beams) -> Result<(), RefinerError> {
    let (elevations, step_rad) = (&beams.elevation_rad, beams.azimuth_step_rad);
    let rising = elevations.windows(2).find(|pair| pair[1] >= pair[0]);
    let steep = elevations.iter().find(|e| e.is_nan() || e.abs() >= 1.5);
    let (expected, found) = if elevations.len() > BEAMS_MAX {
        ("at most 256 beams", elevations.len() as f32)
    } else if let Some(steep) = steep {
        ("elevations within 1.5 rad of the horizon", *steep)
    } else if let Some(pair) = rising {
        ("elevations from the top down", pair[1])
    } else if !(AZIMUTH_STEP_MIN_RAD..0.2).contains(&step_rad) {
        ("an azimuth step of 0.0004 to 0.2 rad", step_rad)
    } else {
        return Ok(());
    };
    let what = "the model's beams";
    Err(RefinerError::new(what, expected, f64::from(found)))
}
