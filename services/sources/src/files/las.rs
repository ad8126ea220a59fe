//! LAS (ASPRS' specification, versions 1.0 to 1.4): a header, records, and points of one format. Coordinates are integers with a scale and an offset,
//! usually map coordinates. Intensity has 16 bits. LAZ, the compressed form, is not read.

use super::table::{Field, Kind, Table};
use super::{Layout, layout::ROWS_MAX};
use crate::{SourceError, refused};

const HEADER_BYTES: usize = 227;
/// Minimum size of a point in any format: x, y, z (i32), intensity (u16), and fields that are not read.
const POINT_BYTES: usize = 20;
/// Distance beyond the range of any sensor, m. If all points are farther away, they are not in the sensor's coordinates.
const FAR_M: f64 = 1000.0;

pub(super) fn table(file: &[u8], layout: &Layout) -> Result<Table, SourceError> {
    if !file.starts_with(b"LASF") || file.len() < HEADER_BYTES {
        return refused("header", "227 bytes of a LAS file", "another file");
    }
    let (start, kind, stride) = (number(file, 96, 4), file[104], number(file, 105, 2));
    let count = match number(file, 107, 4) {
        0 if number(file, 94, 2) >= 255 => number(file, 247, 8),
        count => count,
    };
    if kind & 0x80 != 0 {
        let found = "those of LAZ (`pdal translate IN.laz OUT.las` makes a .las of it)";
        return refused("points", "those of LAS, not compressed", found);
    } else if kind > 10 || stride < POINT_BYTES || start < HEADER_BYTES {
        let found = format!("{kind}, {stride} bytes, behind {start}");
        let expected = "format 0 to 10, 20 bytes or more a point, behind the header";
        return refused("points", expected, found);
    }
    let float = |at: usize| f64::from_bits(number(file, at, 8) as u64);
    let [scale, offset] = [131, 155].map(|at| [at, at + 8, at + 16].map(&float));
    let points = file.get(start..).unwrap_or_default();
    let rows = count.min(ROWS_MAX);
    let mut data = Vec::with_capacity(rows.min(points.len() / stride) * 32);
    let (mut first, mut is_near) = (None, false);
    for point in points.chunks_exact(stride).take(rows) {
        let whole = |axis: usize| number(point, 4 * axis, 4) as u32 as i32;
        let at = [0, 1, 2].map(|axis| f64::from(whole(axis)) * scale[axis] + offset[axis]);
        let away = [0, 1, 2].map(|axis| (at[axis] - layout.origin[axis]) * layout.scale);
        is_near |= away.iter().all(|away_m| away_m.abs() < FAR_M);
        first = first.or(Some(at));
        let numbers = [at[0], at[1], at[2], number(point, 12, 2) as f64];
        data.extend_from_slice(numbers.map(f64::to_le_bytes).as_flattened());
    }
    if let (Some([x, y, z]), false) = (first, is_near) {
        let help = "--origin X,Y,Z says where the sensor is in them";
        let expected = format!("a point within {FAR_M} m of the sensor ({help})");
        let found = format!("none, the first one at {x:.1},{y:.1},{z:.1}");
        return refused("coordinates", expected, found);
    }
    let fields = ["x", "y", "z", "intensity"].map(|name| -> Field { (name.into(), Kind::F64, 1) });
    Ok(Table::of_rows(data, &fields, count))
}

/// An unsigned number of `count` bytes; 0 beyond the end.
fn number(bytes: &[u8], at: usize, count: usize) -> usize {
    let found = bytes.get(at..).and_then(|rest| rest.get(..count)).unwrap_or_default().iter().rev();
    found.fold(0, |all, byte| all << 8 | usize::from(*byte))
}
