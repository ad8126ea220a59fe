//! Reading folders in the format of the KITTI object benchmark.
//!
//! ```text
//! DIR/velodyne/NNNNNN.bin   scans: x, y, z (m, sensor frame), intensity 0..1, f32 little endian (or DIR/NNNNNN.bin)
//! DIR/label_2/NNNNNN.txt    one object per line, camera frame
//! DIR/calib/NNNNNN.txt      P0..P3, R0_rect, Tr_velo_to_cam
//! DIR/ImageSets/SPLIT.txt   frame names of a split, one per line (optional)
//! DIR/planes/NNNNNN.txt     ground plane, camera frame (optional; copied, not read)
//! ```
//!
//! Nothing is repaired silently: a file that does not match the format is an error that names the file, the line,
//! the field, what was expected and what was found.

mod calibration;
mod error;
mod folder;
mod hash;
mod kitti;
mod label;
mod prepare;
mod scan;
pub mod whole_file;

pub use calibration::read_calibration;
pub use error::{DatasetError, Result};
pub use folder::{Dataset, file_stems, read_boxes};
pub use hash::{calibration_hash, data_hash};
pub use kitti::{
    KITTI_CLASSES, SIMULATED_CLASSES, SYNTHETIC_UNKNOWN, Splits, check_classes, check_files,
    is_recognized, unseen_classes,
};
pub use label::{Label, read_detections, read_labels};
pub use prepare::{PrepareOptions, prepare};
pub use scan::{read_scan, scan_bytes};

use std::{io::Error, io::ErrorKind, path::Path};

/// Text files of a data set are small; a larger file is no such text file.
const TEXT_BYTES_MAX: u64 = 16 << 20;

/// Reads a whole text file after a check of its size.
pub fn read_text(path: &Path) -> Result<String> {
    let text = String::from_utf8(read_checked(path, TEXT_BYTES_MAX)?)
        .map_err(|e| DatasetError::read(path)(Error::new(ErrorKind::InvalidData, e)))?;
    // Some editors put a byte order mark at the start of a file; it is not part of the first word.
    Ok(text.strip_prefix('\u{feff}').unwrap_or(&text).to_owned())
}

/// Writes a file of a data set.
pub fn write_file(path: &Path, bytes: &[u8]) -> Result<()> {
    std::fs::write(path, bytes).map_err(DatasetError::write(path))
}

/// Creates a folder of a data set, its parents and its subfolders.
pub fn make_folders(root: &Path, parts: &[&str]) -> Result<()> {
    parts.iter().try_for_each(|part| {
        let folder = root.join(part);
        std::fs::create_dir_all(&folder).map_err(DatasetError::write(&folder))
    })
}

/// Reads a whole file after a check of its size.
fn read_checked(path: &Path, limit: u64) -> Result<Vec<u8>> {
    let failed = DatasetError::read(path);
    let bytes = std::fs::metadata(path).map_err(&failed)?.len();
    if bytes > limit {
        let expected = format!("at most {limit} bytes");
        return Err(DatasetError::at(path, expected, bytes));
    }
    std::fs::read(path).map_err(failed)
}
