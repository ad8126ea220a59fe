//! Calibration files of one sensor unit, as the vendors' tools write them.

use super::ouster::Metadata;
use crate::{SourceError, refused};
use serde::Deserialize;

/// Twice the number of beams of the largest sensor.
const BEAMS_MAX: usize = 256;
/// Far above the size of any calibration file.
const BYTES_MAX: usize = 4 << 20;

/// The beam angles of one unit and the other values that its vendor measured.
#[derive(Clone, Debug)]
pub enum Calibration {
    /// A YAML file with a list `lasers`, angles in rad, distances in m: the format of the common drivers.
    Velodyne(VelodyneTable),
    /// A CSV file: a header line, then channel, elevation, azimuth relative to the block's, clockwise (degrees). The list keeps the two angles.
    Hesai(Vec<[f32; 2]>),
    /// The sensor's metadata, JSON.
    Ouster(Box<Metadata>),
}

/// Velodyne's `lasers`, sorted by laser id.
#[derive(Clone, Debug)]
pub struct VelodyneTable {
    pub(super) lasers: Vec<Laser>,
    /// Unit of the distances, m. Where it is absent, the product's unit applies.
    pub(super) unit_m: Option<f32>,
}

/// Corrections of a laser (manual 63-9194, appendix on calibration).
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Laser {
    pub(super) laser_id: usize,
    pub(super) rot_correction: f32,
    pub(super) vert_correction: f32,
    pub(super) dist_correction: f32,
    pub(super) two_pt_correction_available: bool,
    pub(super) dist_correction_x: f32,
    pub(super) dist_correction_y: f32,
    pub(super) vert_offset_correction: f32,
    pub(super) horiz_offset_correction: f32,
}

#[derive(Deserialize)]
struct VelodyneFile {
    lasers: Vec<Laser>,
    distance_resolution: Option<f32>,
}

impl Calibration {
    /// Reads a calibration file of any of the vendors and recognizes the vendor by the content.
    pub fn parse(text: &str) -> Result<Calibration, SourceError> {
        if text.len() > BYTES_MAX {
            let expected = format!("at most {BYTES_MAX} bytes");
            return refused("calibration: the file", expected, text.len());
        }
        let text = text.trim_start_matches('\u{feff}').trim();
        if text.starts_with('{') {
            Metadata::parse(text).map(|metadata| Calibration::Ouster(Box::new(metadata)))
        } else if text.contains("lasers:") {
            VelodyneTable::parse(text).map(Calibration::Velodyne)
        } else {
            channels(text).map(Calibration::Hesai)
        }
    }

    /// The error for packets of another sensor.
    pub(super) fn is_not(&self, found: &str) -> SourceError {
        SourceError::field("packets", self.describe(), found)
    }

    pub(super) fn describe(&self) -> String {
        match self {
            Calibration::Velodyne(table) => {
                format!("a Velodyne with {} lasers", table.lasers.len())
            }
            Calibration::Hesai(channels) => format!("a Hesai with {} channels", channels.len()),
            Calibration::Ouster(metadata) => metadata.describe(),
        }
    }
}

impl VelodyneTable {
    fn parse(text: &str) -> Result<VelodyneTable, SourceError> {
        let file: VelodyneFile = yaml_serde::from_str(text)
            .map_err(|cause| SourceError::field("calibration: YAML", "a list `lasers`", cause))?;
        let mut lasers = file.lasers;
        lasers.sort_by_key(|laser| laser.laser_id);
        let ids = lasers.iter().map(|laser| laser.laser_id);
        if lasers.len() > BEAMS_MAX || !ids.eq(0..lasers.len()) {
            let found = format!("{} lasers", lasers.len());
            let expected = "each laser_id from 0 on once, at most 256";
            return refused("calibration: lasers", expected, found);
        }
        for l in &lasers {
            let near_m = [l.dist_correction, l.dist_correction_x, l.dist_correction_y];
            let off_m = [l.vert_offset_correction, l.horiz_offset_correction];
            let angles_rad = [l.rot_correction, l.vert_correction];
            // NaN is not within the limits.
            let is_fine = near_m.iter().chain(&off_m).all(|m| m.abs() <= 10.0)
                && angles_rad.iter().all(|rad| rad.abs() <= 6.3);
            if !is_fine {
                let field = format!("calibration: laser {}", l.laser_id);
                let expected = "corrections of at most 10 m and 6.3 rad";
                return refused(field, expected, format!("{l:?}"));
            }
        }
        let unit_m = file.distance_resolution;
        if unit_m.is_some_and(|unit_m| !(1e-4..=0.1).contains(&unit_m)) {
            let found = unit_m.unwrap_or_default();
            let field = "calibration: distance_resolution";
            return refused(field, "0.0001 to 0.1 m", found);
        }
        Ok(VelodyneTable { lasers, unit_m })
    }
}

fn channels(text: &str) -> Result<Vec<[f32; 2]>, SourceError> {
    let mut channels = Vec::new();
    // Where the first line names the format, the header is the second line.
    let headers = if text.starts_with("EEFF") { 2 } else { 1 };
    for (index, line) in text.lines().enumerate().skip(headers) {
        let fields: Vec<&str> = line.split(',').map(str::trim).collect();
        // An empty line or a checksum.
        if fields.len() < 3 || fields.iter().all(|field| field.is_empty()) {
            continue;
        }
        let numbers: Vec<f32> = fields.iter().filter_map(|field| field.parse().ok()).collect();
        match numbers[..] {
            [id, elevation_deg, azimuth_deg]
                if id == channels.len() as f32 + 1.0
                    && elevation_deg.abs() <= 90.0
                    && azimuth_deg.abs() <= 360.0
                    && channels.len() < BEAMS_MAX =>
            {
                channels.push([elevation_deg, azimuth_deg]);
            }
            _ => {
                let expected = "channel (1, 2, ..), elevation, azimuth (degrees)";
                let field = format!("calibration: line {}", index + 1);
                let found: String = line.chars().take(60).collect();
                return refused(field, expected, found);
            }
        }
    }
    if channels.is_empty() {
        let expected = "Velodyne's YAML, Hesai's CSV or Ouster's JSON";
        return refused("calibration: the file", expected, "none of them");
    }
    Ok(channels)
}
