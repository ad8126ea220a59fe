//! What the refiner must know of the model and its sensor.

use mluc_model::{HeadKind, Manifest};

use crate::RefinerError;

/// Beams of a range image.
#[derive(Clone, Debug, PartialEq)]
pub struct BeamTable {
    /// Elevation of each beam, rad, from the top down.
    pub elevation_rad: Vec<f32>,
    /// Azimuth step of a column, rad.
    pub azimuth_step_rad: f32,
}

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
    pub beams: Option<BeamTable>,
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
        let table = &manifest.beams;
        let step = match table.azimuth_step_rad {
            0.0 => AZIMUTH_STEP_DEFAULT_RAD,
            step => step,
        };
        let beams = (!table.elevation_rad.is_empty()).then(|| BeamTable {
            elevation_rad: table.elevation_rad.clone(),
            azimuth_step_rad: step,
        });
        if let Some(beams) = &beams {
            beams.check()?;
        }
        Ok(Sensor {
            height_m: f64::from(manifest.sensor_height_m),
            beams,
            classes: manifest.classes.iter().map(|c| c.name.clone()).collect(),
            sees_all_around: manifest.network.grid.range_min_m[0] < 0.0,
            tells_unknown: manifest.network.head == HeadKind::Open,
        })
    }
}

impl BeamTable {
    pub(crate) fn check(&self) -> Result<(), RefinerError> {
        let elevations = &self.elevation_rad;
        let rising = elevations.windows(2).find(|pair| pair[1] >= pair[0]);
        let steep = elevations.iter().find(|e| e.is_nan() || e.abs() >= 1.5);
        let (expected, found) = if elevations.len() > BEAMS_MAX {
            ("at most 256 beams", elevations.len() as f32)
        } else if let Some(steep) = steep {
            ("elevations within 1.5 rad of the horizon", *steep)
        } else if let Some(pair) = rising {
            ("elevations from the top down", pair[1])
        } else if !(AZIMUTH_STEP_MIN_RAD..0.2).contains(&self.azimuth_step_rad) {
            (
                "an azimuth step of 0.0004 to 0.2 rad",
                self.azimuth_step_rad,
            )
        } else {
            return Ok(());
        };
        Err(RefinerError::Beams {
            expected,
            found: f64::from(found),
        })
    }
}
