//! Scans: little-endian f32 x, y, z, intensity per point.

use super::{DatasetError, Result, read_checked};
use mluc_ingest::{POINT_BYTES, bin_points};
use std::path::Path;

/// Maximum number of points in one file: about thirty times a full scan of 128 beams. A larger file is not one scan.
const SCAN_POINTS_MAX: usize = 8_000_000;

/// Reads a scan unchanged, with NaN and infinities, which later steps drop and count. An empty file is a scan of 0 points.
pub fn read_scan(path: &Path) -> Result<Vec<[f32; 4]>> {
    let data = read_checked(path, (SCAN_POINTS_MAX * POINT_BYTES) as u64)?;
    check_size(path, data.len() as u64)?;
    let points = bin_points(&data);
    Ok(points.map(|p| [p.x_m, p.y_m, p.z_m, p.intensity]).collect())
}

/// The bytes of a scan's file.
pub fn scan_bytes(points: &[[f32; 4]]) -> Vec<u8> {
    points.as_flattened().iter().flat_map(|value| value.to_le_bytes()).collect()
}

/// Checks that a scan is a whole number of points, without reading the file.
pub(super) fn check_scan_size(path: &Path) -> Result<()> {
    let file = std::fs::metadata(path).map_err(DatasetError::read(path))?;
    check_size(path, file.len())
}

fn check_size(path: &Path, bytes: u64) -> Result<()> {
    if bytes.is_multiple_of(POINT_BYTES as u64) {
        return Ok(());
    }
    let expected = "a multiple of 16 bytes (x, y, z, intensity as f32)";
    let found = format!("{bytes} bytes: cut short?");
    Err(DatasetError::at(path, expected, found))
}
