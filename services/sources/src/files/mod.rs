//! Files of one scan each: KITTI's and nuScenes' `.bin`, NumPy's `.npy`, PCD, PLY, LAS. Each becomes KITTI's layout.

mod bin;
mod cloud;
mod las;
mod layout;
mod npy;
mod pcd;
mod ply;
mod table;
#[cfg(test)]
mod tests;

use std::path::Path;

use mluc_ipc_types::POINTS_MAX;

pub(crate) use bin::check_columns;
pub(crate) use cloud::{CLOUDS, Cloud, Reader};
pub use layout::Layout;

use crate::{Scan, SourceError};

/// How a file holds its points.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Format {
    /// f32 without a header, four a point as KITTI's, or as many as [`Layout::columns`] names.
    Bin,
    /// nuScenes' `.pcd.bin`: five f32 a point, intensities to 255, as a rule with x to the right and y ahead.
    NuScenes,
    /// NumPy's array of N rows and three or more columns, or of named fields.
    Npy,
    /// Of the Point Cloud Library: ascii, binary, binary_compressed.
    Pcd,
    /// The polygon format's vertices: ascii, binary.
    Ply,
    /// ASPRS' format of surveys, 1.0 to 1.4, not compressed.
    Las,
}

impl Format {
    /// The endings that are known, the longest first.
    pub const ENDINGS: [(&str, Format); 6] = [
        (".pcd.bin", Format::NuScenes),
        (".bin", Format::Bin),
        (".npy", Format::Npy),
        (".pcd", Format::Pcd),
        (".ply", Format::Ply),
        (".las", Format::Las),
    ];

    /// By a file's name; `None`: none that is known.
    pub fn of(path: &Path) -> Option<Format> {
        let name = path.file_name()?.to_str()?.to_ascii_lowercase();
        let mut endings = Format::ENDINGS.iter();
        let found = endings.find(|(ending, _)| name.ends_with(ending));
        found.map(|(_, format)| *format)
    }

    /// Turns a file's bytes into the scan's: x, y, z (m) and intensity, four little-endian f32 a point, KITTI's layout; and into times, if `layout` asks for them. The axes
    /// are the file's unless `layout` turns them. True: the file ends before what it promises. Errors: what in the file, or in `layout`, is not as expected.
    pub fn convert(
        self,
        layout: &Layout,
        file: Vec<u8>,
        scan: &mut Scan,
    ) -> Result<bool, SourceError> {
        scan.times_ns.clear();
        if self == Format::Bin && *layout == Layout::default() {
            scan.bytes = file;
            return Ok(!scan.bytes.len().is_multiple_of(16));
        }
        let table = match self {
            Format::Bin => bin::table(file, layout, 4)?,
            Format::NuScenes => bin::table(file, layout, 5)?,
            Format::Npy => npy::table(&file, layout)?,
            Format::Pcd => pcd::table(&file)?,
            Format::Ply => ply::table(&file)?,
            Format::Las => las::table(&file, layout)?,
        };
        let mut layout = layout.clone();
        match self {
            Format::NuScenes => layout.intensity_scale /= 255.0,
            Format::Las => layout.intensity_scale /= f64::from(u16::MAX),
            _ => {}
        }
        scan.bytes = Vec::with_capacity(table.rows.min(POINTS_MAX) * 16);
        layout.write(&table, scan)
    }
}
