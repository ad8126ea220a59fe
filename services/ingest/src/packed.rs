//! Scans in 7 bytes a point, for the ones that the program brings along: i16 x, y, z in steps of 5 mm and u8 intensity,
//! little-endian, after 8 bytes of magic and a u32 count.

use mluc_ipc_types::{POINTS_MAX, Point};

const MAGIC: &[u8; 8] = b"MLUCSCN1";
const HEADER_BYTES: usize = 12;
const POINT_BYTES: usize = 7;
/// Range of i16: 163 m to each side.
const STEP_M: f32 = 0.005;

/// A packed scan that cannot be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("packed scan: expected {expected}, found {found}")]
pub struct PackedError {
    expected: &'static str,
    found: usize,
}

/// Packs points; coordinates beyond 163 m are cut there, intensities to 0..1.
pub fn pack(points: &[Point]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(HEADER_BYTES + points.len() * POINT_BYTES);
    bytes.extend_from_slice(MAGIC);
    bytes.extend_from_slice(&(points.len() as u32).to_le_bytes());
    for point in points {
        for value_m in [point.x_m, point.y_m, point.z_m] {
            // `as` saturates.
            bytes.extend_from_slice(&((value_m / STEP_M).round() as i16).to_le_bytes());
        }
        bytes.push((point.intensity * 255.0).round() as u8);
    }
    bytes
}

/// Reads what [`pack`] wrote.
pub fn unpack(bytes: &[u8]) -> Result<Vec<Point>, PackedError> {
    let fault = |expected, found| Err(PackedError { expected, found });
    let Some((header, body)) = bytes.split_at_checked(HEADER_BYTES) else {
        return fault("12 bytes of header", bytes.len());
    };
    let (magic, count) = header.split_at(MAGIC.len());
    if magic != MAGIC {
        return fault("it to begin with MLUCSCN1", magic[0].into());
    }
    let count = u32::from_le_bytes([count[0], count[1], count[2], count[3]]) as usize;
    if count > POINTS_MAX {
        return fault("at most 262144 points", count);
    }
    let (chunks, rest) = body.as_chunks::<POINT_BYTES>();
    if chunks.len() != count || !rest.is_empty() {
        return fault("7 bytes for each point that the header counts", body.len());
    }
    let value_m = |low: u8, high: u8| f32::from(i16::from_le_bytes([low, high])) * STEP_M;
    let point = |&[x0, x1, y0, y1, z0, z1, intensity]: &[u8; POINT_BYTES]| Point {
        x_m: value_m(x0, x1),
        y_m: value_m(y0, y1),
        z_m: value_m(z0, z1),
        intensity: f32::from(intensity) / 255.0,
    };
    Ok(chunks.iter().map(point).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_come_back_within_half_a_step() {
        let points = (0..500).map(|n| n as f32).map(|n| Point {
            x_m: n * 0.123 - 30.0,
            y_m: -n * 0.2,
            z_m: -1.7 + n * 0.001,
            intensity: n / 499.0,
        });
        let points: Vec<Point> = points.collect();
        let back = unpack(&pack(&points)).unwrap();
        assert_eq!(back.len(), points.len());
        for (a, b) in points.iter().zip(&back) {
            for (a_m, b_m) in [(a.x_m, b.x_m), (a.y_m, b.y_m), (a.z_m, b.z_m)] {
                assert!((a_m - b_m).abs() <= 0.0026, "{a_m} {b_m}");
            }
            assert!((a.intensity - b.intensity).abs() <= 0.002);
        }
    }

    #[test]
    fn damaged_bytes_are_errors() {
        let whole = pack(&[Point::default(); 3]);
        for end in 0..whole.len() {
            assert!(unpack(&whole[..end]).is_err(), "{end}");
        }
        let mut many = whole.clone();
        many[8..12].copy_from_slice(&u32::MAX.to_le_bytes());
        let error = unpack(&many).unwrap_err().to_string();
        let expected = "at most 262144 points, found 4294967295";
        assert!(error.contains(expected), "{error}");
    }
}
