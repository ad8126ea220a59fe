//! Files with one scan each: KITTI's and nuScenes' `.bin`, NumPy's `.npy`, PCD, PLY, LAS. All are converted to KITTI's layout.

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

use mluc_ipc_types::POINTS_MAX;
use std::path::Path;

use crate::{Scan, SourceError};
pub(crate) use bin::{check_columns, has_negative_intensities};
pub(crate) use cloud::{CLOUDS, Cloud, Reader};
pub use layout::Layout;
use table::Column;

/// Format of a file with points.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Format {
    /// f32 values without a header: four per point as in KITTI, or as many as [`Layout::columns`] names.
    Bin,
    /// nuScenes' `.pcd.bin`: five f32 per point, intensities up to 255, usually with x to the right and y forward.
    NuScenes,
    /// NumPy array with N rows and three or more columns, or with named fields.
    Npy,
    /// Format of the Point Cloud Library: ascii, binary, binary_compressed.
    Pcd,
    /// Vertices of the polygon file format: ascii, binary.
    Ply,
    /// ASPRS' format for surveys, versions 1.0 to 1.4, not compressed.
    Las,
}

impl Format {
    /// The known file endings, the longest first.
    pub const ENDINGS: [(&str, Format); 6] = [
        (".pcd.bin", Format::NuScenes),
        (".bin", Format::Bin),
        (".npy", Format::Npy),
        (".pcd", Format::Pcd),
        (".ply", Format::Ply),
        (".las", Format::Las),
    ];

    /// Finds the format by a file's name; `None`: the ending is unknown.
    pub fn of(path: &Path) -> Option<Format> {
        let name = path.file_name()?.to_string_lossy().to_ascii_lowercase();
        Format::ENDINGS.iter().find(|(ending, _)| name.ends_with(ending)).map(|(_, format)| *format)
    }

    /// Converts a file to KITTI's layout: x, y, z (m), intensity, four little-endian f32 per point; also to times if `layout` requests them. Axes are the
    /// file's unless `layout` changes them. True: the file has fewer or more points than it announces. Errors: unexpected content in the file or in `layout`.
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
        let is_short = layout.write(&table, scan)?;
        // In files of the other formats something else may follow the points. Older PCL writes zeros after them.
        let end = |last: &Column| last.start.saturating_add(last.stride.saturating_mul(table.rows));
        let last = table.columns.last();
        let rest = last.and_then(|last| table.data.get(end(last)..));
        let is_long =
            self == Format::Pcd && rest.is_some_and(|rest| rest.iter().any(|byte| *byte != 0));
        Ok(is_short || is_long)
    }
}
