//! f32 values without a header: four per point as in KITTI, five as in nuScenes, or another number.

use super::Layout;
use super::table::{Field, Kind, Table};
use crate::{SourceError, refused};

/// Refuses files that have three or five to eight numbers per point instead of four, and numbers that are no coordinates. `sizes`: sizes of some files,
/// bytes; `start`: start of the first file. A file of another size than most is cut short.
pub(crate) fn check_columns(sizes: &[u64], start: &[u8]) -> Result<(), SourceError> {
    let all = |columns: u64| {
        let fitting = sizes.iter().filter(|size| size.is_multiple_of(4 * columns));
        2 * fitting.count() > sizes.len()
    };
    let is_other = |columns: &u64| match columns {
        _ if !all(4) => true,
        5 | 7 | 8 if has_rings(start, *columns as usize) => true,
        8 => false,
        _ => has_negative_intensities(start, 4),
    };
    let columns = [5, 6, 3, 7, 8].into_iter();
    let columns = columns.filter(|columns| all(*columns) && is_other(columns));
    let columns: Vec<String> = columns.map(|columns| columns.to_string()).collect();
    match columns.first() {
        Some(_) => {
            let help = "say which with --columns x,y,z,intensity,..";
            let (bytes, columns) = (sizes[0], columns.join(" or "));
            let found = format!("{bytes} bytes: {columns} columns? {help}");
            refused("size", "16 bytes a point (x, y, z, intensity)", found)
        }
        None if has_no_coordinates(start) => {
            let found = "many below 0.000001 or above 1,000,000: text, f64, or another byte order?";
            refused("numbers", "f32 in little-endian order, in m", found)
        }
        None => Ok(()),
    }
}

/// Whether more than a tenth of x and y are too small or too large for coordinates. Zeros are not.
fn has_no_coordinates(start: &[u8]) -> bool {
    let numbers = numbers(start);
    let points = numbers.as_chunks::<4>().0;
    let is_odd = |v: &&f32| **v != 0.0 && !(1e-6..1e6).contains(&v.abs()) && v.is_finite();
    let odd = points.iter().flat_map(|p| &p[..2]).filter(is_odd).count();
    10 * odd > 2 * points.len()
}

/// Whether the fourth number is negative in more than one hundredth of the points. It is then a coordinate. `columns`: numbers per point.
pub(crate) fn has_negative_intensities(start: &[u8], columns: usize) -> bool {
    let numbers = numbers(start);
    let points = || numbers.chunks_exact(columns);
    points().filter(|point| point[3] < 0.0).count() * 100 > points().len()
}

fn numbers(bytes: &[u8]) -> Vec<f32> {
    bytes.as_chunks::<4>().0.iter().map(|v| f32::from_le_bytes(*v)).collect()
}

/// Whether the fifth number of 100 or more points is a ring. `columns`: numbers per point. If four columns have whole numbers there (missing returns), the first is whole too.
fn has_rings(start: &[u8], columns: usize) -> bool {
    let numbers = numbers(start);
    let points = || numbers.chunks_exact(columns);
    let is_ring = |v: f32| v.fract() == 0.0 && (0.0..=255.0).contains(&v);
    points().len() >= 100
        && points().all(|point| is_ring(point[4]))
        && points().any(|point| point[4] != numbers[4])
        && !points().all(|point| is_ring(point[0]))
}

/// `columns`: number of columns in a file if the layout names none.
pub(super) fn table(file: Vec<u8>, layout: &Layout, columns: usize) -> Result<Table, SourceError> {
    let names = layout.names(columns).into_iter();
    let fields: Vec<Field> = names.map(|name| (name, Kind::F32, 1)).collect();
    let bytes = 4 * fields.len();
    let rows = file.len().div_ceil(bytes);
    Ok(Table::of_rows(file, &fields, rows))
}
