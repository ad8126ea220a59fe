//! Files of one scan each: KITTI's and nuScenes' `.bin`, NumPy's `.npy`, PCD, PLY. Each becomes KITTI's layout.

mod bin;
mod cloud;
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
pub(crate) use cloud::{CLOUDS, Cloud};
pub use layout::Layout;

use crate::SourceError;

/// How a file holds its points.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Format {
    /// f32 without a header, four a point as KITTI's, or as many as [`Layout::columns`] names.
    Bin,
    /// nuScenes' `.pcd.bin`: five f32 a point, intensities to 255.
    NuScenes,
    /// NumPy's array of N rows and three or more columns, or of named fields.
    Npy,
    /// Of the Point Cloud Library: ascii, binary, binary_compressed.
    Pcd,
    /// The polygon format's vertices: ascii, binary.
    Ply,
}

impl Format {
    /// The endings that are known, the longest first.
    pub const ENDINGS: [(&str, Format); 5] = [
        (".pcd.bin", Format::NuScenes),
        (".bin", Format::Bin),
        (".npy", Format::Npy),
        (".pcd", Format::Pcd),
        (".ply", Format::Ply),
    ];

    /// By a file's name; `None`: none that is known.
    pub fn of(path: &Path) -> Option<Format> {
        let name = path.file_name()?.to_str()?.to_ascii_lowercase();
        let found = Format::ENDINGS
            .iter()
            .find(|(ending, _)| name.ends_with(ending));
        found.map(|(_, format)| *format)
    }

    /// Turns a file's bytes into x, y, z (m, forward, left, up) and intensity, four little-endian f32 a point: KITTI's layout. True: the file
    /// ends before what it promises. Errors: what in the file, or in `layout`, is not as expected.
    pub fn convert(self, layout: &Layout, file: Vec<u8>) -> Result<(Vec<u8>, bool), SourceError> {
        if self == Format::Bin && *layout == Layout::default() {
            return Ok((file, false));
        }
        let table = match self {
            Format::Bin => bin::table(file, layout, 4)?,
            Format::NuScenes => bin::table(file, layout, 5)?,
            Format::Npy => npy::table(&file, layout)?,
            Format::Pcd => pcd::table(&file)?,
            Format::Ply => ply::table(&file)?,
        };
        let mut layout = layout.clone();
        if self == Format::NuScenes {
            layout.intensity_scale /= 255.0;
        }
        let mut out = Vec::with_capacity(table.rows.min(POINTS_MAX) * 16);
        let is_cut = layout.write(&table, &mut out)?;
        Ok((out, is_cut))
    }
}
