//! The description of a LiDAR: its beams, its range and its mounting. `sensors/*.toml` describes real products; users add their own.

use crate::error::ModelError;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Pose, in the frame of the scan, of one of several equal sensors whose scans are merged: rotated about x (roll), then y (pitch), then z (yaw).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SensorUnit {
    /// Position x, y, z, m.
    pub at_m: [f32; 3],
    /// Rotation about z, degrees.
    pub yaw_deg: f32,
    /// Rotation about y, degrees: positive looks down.
    pub pitch_deg: f32,
    /// Rotation about x, degrees.
    pub roll_deg: f32,
}

/// A sector that the robot's own body hides: it has no returns, or the driver leaves them out.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BlindSector {
    /// Middle and width, degrees, counter-clockwise from ahead.
    pub azimuth_deg: [f32; 2],
    /// Highest hidden elevation, degrees; if absent, all elevations are hidden.
    #[serde(default = "up_to_the_zenith")]
    pub below_deg: f32,
}

fn up_to_the_zenith() -> f32 {
    90.0
}

impl BlindSector {
    /// Whether a direction lies in the sector.
    pub fn hides(&self, azimuth_deg: f32, elevation_deg: f32) -> bool {
        let [middle_deg, width_deg] = self.azimuth_deg;
        let is_within = degrees_off(azimuth_deg, middle_deg) <= width_deg / 2.0;
        is_within && elevation_deg <= self.below_deg
    }
}

/// The angle between two directions, 0 to 180 degrees.
pub fn degrees_off(a_deg: f32, b_deg: f32) -> f32 {
    ((a_deg - b_deg + 540.0).rem_euclid(360.0) - 180.0).abs()
}

/// Scan lines that move up and down during a sweep: mirrors of a raster, prisms of a rosette.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Wave {
    /// Amplitude above and below a line's elevation, degrees.
    pub height_deg: f32,
    /// Number of waves per full turn; each line has its own phase.
    pub a_turn: f32,
}

/// A LiDAR that spins or sweeps a sector.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorProfile {
    /// Make and type.
    pub name: String,
    /// Where the numbers come from.
    pub source: String,
    /// Elevation of each beam from the top down, degrees.
    pub elevations_deg: Vec<f32>,
    /// Azimuth of each beam relative to its column, degrees; empty: all 0.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub azimuth_offsets_deg: Vec<f32>,
    /// Height at which each beam begins, above the sensor's origin, m; empty: all 0.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub origin_heights_m: Vec<f32>,
    /// Azimuth step between columns, degrees.
    pub azimuth_step_deg: f32,
    /// Middle and width of the horizontal field, degrees, counter-clockwise from ahead; a full turn if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub field_deg: Option<[f32; 2]>,
    /// Shortest and longest range that is reported, m.
    pub range_m: [f32; 2],
    /// Standard deviation of a range, m.
    pub range_noise_m: f32,
    /// Height above the ground, m; unknown if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub height_m: Option<f32>,
    /// Pitch, degrees; positive looks down.
    #[serde(default)]
    pub pitch_deg: f32,
    /// Roll, degrees; positive lowers the right side.
    #[serde(default)]
    pub roll_deg: f32,
    /// Wave of a raster's or a rosette's lines; straight lines if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wave: Option<Wave>,
    /// Sectors that the robot's own body hides.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub blind: Vec<BlindSector>,
    /// Several equal sensors whose scans are merged into one; empty: one at the origin.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub units: Vec<SensorUnit>,
}

/// The products in `sensors/`: name of the file without its extension, and its text.
const PRODUCTS: &[(&str, &str)] = include!(concat!(env!("OUT_DIR"), "/products.rs"));

impl SensorProfile {
    /// Names of the products that are built in.
    pub fn names() -> impl Iterator<Item = &'static str> {
        PRODUCTS.iter().map(|(name, _)| *name)
    }

    /// A product by its name, or a profile from a TOML file.
    pub fn load(name_or_file: &str) -> Result<SensorProfile, ModelError> {
        if let Some((name, text)) = PRODUCTS.iter().find(|(name, _)| *name == name_or_file) {
            return SensorProfile::parse(text, name);
        }
        let path = Path::new(name_or_file);
        let text = std::fs::read_to_string(path).map_err(|cause| {
            let names: Vec<&str> = SensorProfile::names().collect();
            let cause = format!("{cause}; built in are {}", names.join(", "));
            ModelError::sensor(name_or_file, cause)
        })?;
        SensorProfile::parse(&text, name_or_file)
    }

    /// Parses TOML; `place` is its name in errors.
    pub fn parse(text: &str, place: &str) -> Result<SensorProfile, ModelError> {
        let profile: SensorProfile =
            toml::from_str(text).map_err(|cause| ModelError::sensor(place, cause.to_string()))?;
        profile.check().map_err(|cause| ModelError::sensor(place, cause))?;
        Ok(profile)
    }

    /// The highest and the lowest elevation, degrees.
    pub fn vertical_field_deg(&self) -> [f32; 2] {
        let high_deg = self.wave.map_or(0.0, |wave| wave.height_deg);
        let ends = [self.elevations_deg.first(), self.elevations_deg.last()];
        let [top, bottom] = ends.map(|end| end.copied().unwrap_or_default());
        [top + high_deg, bottom - high_deg]
    }

    /// Whether the robot's own body hides an object at this azimuth.
    pub fn hides(&self, azimuth_deg: f32) -> bool {
        self.blind.iter().any(|sector| sector.hides(azimuth_deg, 0.0))
    }

    /// Checks that every number is in its range; the error names the field, the expected range and the found value.
    fn check(&self) -> Result<(), String> {
        let beams = self.check_beams()?;
        within("azimuth_step_deg", self.azimuth_step_deg, 0.003, 2.0)?;
        let [middle, width] = self.field_deg.unwrap_or([0.0, 360.0]);
        within("field_deg (middle)", middle, -180.0, 180.0)?;
        within("field_deg (width)", width, 1.0, 360.0)?;
        if let Some(wave) = self.wave {
            within("wave.height_deg", wave.height_deg, 0.0, 60.0)?;
            within("wave.a_turn", wave.a_turn, 0.0, 1000.0)?;
        }
        within("blind (sectors)", self.blind.len() as f32, 0.0, 72.0)?;
        for BlindSector { azimuth_deg: [middle_deg, width_deg], below_deg } in
            self.blind.iter().copied()
        {
            within("blind.azimuth_deg (middle)", middle_deg, -180.0, 180.0)?;
            within("blind.azimuth_deg (width)", width_deg, 0.0, 360.0)?;
            within("blind.below_deg", below_deg, -90.0, 90.0)?;
        }
        let rays = (beams * self.units.len().max(1)) as f32 * width / self.azimuth_step_deg;
        within("rays (beams x columns)", rays, 1.0, 1e6)?;
        within("range_m (shortest)", self.range_m[0], 0.0, 10.0)?;
        let shortest_m = self.range_m[0].max(5.0);
        within("range_m (longest)", self.range_m[1], shortest_m, 500.0)?;
        within("range_noise_m", self.range_noise_m, 0.0, 0.5)?;
        within("height_m", self.height_m.unwrap_or(1.0), 0.05, 10.0)?;
        within("pitch_deg", self.pitch_deg, -30.0, 30.0)?;
        within("roll_deg", self.roll_deg, -30.0, 30.0)?;
        if !self.units.is_empty() && [self.pitch_deg, self.roll_deg] != [0.0; 2] {
            return Err(
                "pitch_deg, roll_deg: expected those of each of the units, found one for all"
                    .into(),
            );
        }
        for unit in &self.units {
            for at_m in unit.at_m {
                within("units.at_m", at_m, -20.0, 20.0)?;
            }
            for angle in [unit.yaw_deg, unit.pitch_deg, unit.roll_deg] {
                within("units (yaw, pitch, roll, degrees)", angle, -360.0, 360.0)?;
            }
        }
        within("units", self.units.len() as f32, 0.0, 4.0)
    }

    /// Checks the lists with a number for each beam; returns the number of beams.
    fn check_beams(&self) -> Result<usize, String> {
        let beams = self.elevations_deg.len();
        within("elevations_deg (beams)", beams as f32, 1.0, 256.0)?;
        for (list, found) in [
            ("azimuth_offsets_deg", self.azimuth_offsets_deg.len()),
            ("origin_heights_m", self.origin_heights_m.len()),
        ] {
            if found != 0 && found != beams {
                return Err(format!("{list}: expected none or {beams}, found {found}"));
            }
        }
        for &elevation in &self.elevations_deg {
            within("elevations_deg", elevation, -90.0, 90.0)?;
        }
        let mut pairs = self.elevations_deg.array_windows();
        if let Some([upper, lower]) = pairs.find(|[upper, lower]| upper < lower) {
            let found = format!("found {lower} after {upper}");
            return Err(format!("elevations_deg: expected from the top down, {found}"));
        }
        for &offset in &self.azimuth_offsets_deg {
            within("azimuth_offsets_deg", offset, -360.0, 360.0)?;
        }
        for &height_m in &self.origin_heights_m {
            within("origin_heights_m", height_m, -1.0, 1.0)?;
        }
        Ok(beams)
    }
}

fn within(field: &str, value: f32, low: f32, high: f32) -> Result<(), String> {
    let fine = (low..=high).contains(&value);
    let fault = || format!("{field}: expected {low} to {high}, found {value}");
    fine.then_some(()).ok_or_else(fault)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blind_sectors_hide_what_is_below_them_and_survive_being_written() {
        let (_, text) = PRODUCTS[0];
        let blind = "blind = [{ azimuth_deg = [180.0, 40.0], below_deg = -10.0 }, { azimuth_deg = [90.0, 20.0] }]";
        let profile = SensorProfile::parse(&format!("{blind}\n{text}"), "mine").expect("sound");
        assert!(profile.hides(95.0) && !profile.hides(101.0) && !profile.hides(170.0));
        let behind = profile.blind[0];
        assert!(behind.hides(-165.0, -11.0) && !behind.hides(-165.0, -9.0));
        let written = toml::to_string(&profile).expect("written");
        let read = SensorProfile::parse(&written, "written").expect("read");
        assert_eq!(read, profile);
    }

    #[test]
    fn a_fault_names_file_field_expected_and_found() {
        let (_, text) = PRODUCTS[0];
        let noisy = text.replace("range_noise_m = 0", "range_noise_m = 9");
        let fault = SensorProfile::parse(&noisy, "mine.toml").expect_err("refused");
        let fault = fault.to_string();
        let words = ["mine.toml", "range_noise_m: expected 0 to 0.5"];
        assert!(words.iter().all(|word| fault.contains(word)), "{fault}");
        let in_cm = format!("{text}\n[[units]]\nat_m = [120, 0, 150]");
        let fault = SensorProfile::parse(&in_cm, "cm").expect_err("refused");
        assert!(fault.to_string().contains("units.at_m"), "{fault}");
        let fault = SensorProfile::load("no-such-sensor").expect_err("refused");
        assert!(fault.to_string().contains("vlp-16"), "{fault}");
    }
}
