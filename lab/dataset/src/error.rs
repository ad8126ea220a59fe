//! What can be wrong with a data set.

use mluc_geometry::CalibrationError;
use std::path::PathBuf;

/// A fault in a folder or file of a data set: where it is, what was expected, what was found.
#[derive(Debug, thiserror::Error)]
pub enum DatasetError {
    /// The system refused: missing, not readable, not text.
    #[error("{}: cannot be read", path.display())]
    Read {
        /// File or folder.
        path: PathBuf,
        /// The system's answer.
        source: std::io::Error,
    },
    /// A folder that is not there.
    #[error("{}: expected a folder of {expected}, found {found}", path.display())]
    NotAFolder {
        /// The folder's path.
        path: PathBuf,
        /// What it should hold.
        expected: &'static str,
        /// "nothing" or "a file".
        found: &'static str,
    },
    /// A folder without a file of the wanted kind.
    #[error("{}: expected {expected}, found none", path.display())]
    Empty {
        /// The folder.
        path: PathBuf,
        /// What it should hold.
        expected: &'static str,
    },
    /// A scan whose size is not a whole number of points.
    #[error("{}: expected a multiple of 16 bytes (x, y, z, intensity as f32), found {found} bytes: cut short?", path.display())]
    ScanSize {
        /// The scan.
        path: PathBuf,
        /// Its size, bytes.
        found: u64,
    },
    /// A file beyond the limit of its kind.
    #[error("{}: expected at most {limit} bytes, found {found}", path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Limit, bytes.
        limit: u64,
        /// Size, bytes.
        found: u64,
    },
    /// A line with too few or too many columns.
    #[error("{}, line {line}: expected {expected} columns, found {found}{}", path.display(), missing_note(missing))]
    Columns {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// The column counts that are taken.
        expected: &'static str,
        /// How many there are.
        found: usize,
        /// Name of the first missing column; empty when there are too many.
        missing: &'static str,
    },
    /// A field that is not what it should be.
    #[error("{}, line {line}, field {field}: expected {expected}, found '{found}'", path.display())]
    Field {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// Name of the field.
        field: &'static str,
        /// What it should be.
        expected: &'static str,
        /// What is there.
        found: String,
    },
    /// A label of a class that nobody has heard of: misspelt, its object would be left out without a word.
    #[error("{}, line {line}, field type: expected {expected}, found '{found}'", path.display())]
    Class {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// The classes that are heard of.
        expected: String,
        /// What is there.
        found: String,
    },
    /// A frame that a list names twice.
    #[error("{}, line {line}: expected each frame once, found '{found}' again", path.display())]
    RepeatedFrame {
        /// The list.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// The name.
        found: String,
    },
    /// A calibration without one of its matrices.
    #[error("{}: expected a line '{name}: ...', found none", path.display())]
    MissingMatrix {
        /// The file.
        path: PathBuf,
        /// Name of the matrix.
        name: &'static str,
    },
    /// A calibration that cannot be used.
    #[error("{}: {cause}", path.display())]
    Calibration {
        /// The file.
        path: PathBuf,
        /// Why not.
        cause: CalibrationError,
    },
    /// A split that names a frame without a scan.
    #[error("{}, line {line}: expected the name of a frame in {}, found '{found}'", path.display(), scans.display())]
    UnknownFrame {
        /// The split.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// The folder of scans.
        scans: PathBuf,
        /// The name.
        found: String,
    },
    /// A data set without one of its lists of frames.
    #[error(
        "split {split}: expected the list of its frames, {split}.txt, in {looked}, found none; give the folder that holds it"
    )]
    NoSplit {
        /// Name of the split.
        split: String,
        /// The folders that were looked into.
        looked: String,
    },
    /// A frame without one of its files.
    #[error("frame {frame}: expected its {what} in {}, found no such file", path.display())]
    MissingFile {
        /// Name of the frame.
        frame: String,
        /// What is missing.
        what: &'static str,
        /// Where it should be.
        path: PathBuf,
    },
    /// The system refused to write.
    #[error("{}: cannot be written: {cause}", path.display())]
    Write {
        /// File or folder.
        path: PathBuf,
        /// The system's answer.
        cause: std::io::Error,
    },
    /// A folder to be written that is there already.
    #[error("{}: expected a new folder, found one that is there already; choose another or remove it", path.display())]
    NotNew {
        /// The folder.
        path: PathBuf,
    },
}

fn missing_note(missing: &str) -> String {
    if missing.is_empty() {
        String::new()
    } else {
        format!(" (no {missing})")
    }
}
