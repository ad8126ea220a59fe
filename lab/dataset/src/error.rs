//! What can be wrong with a data set.

use mluc_geometry::CalibrationError;
use std::fmt::Display;
use std::path::{Path, PathBuf};

/// A fault in a folder or file of a data set: where it is, what was expected, what was found.
#[derive(Debug, thiserror::Error)]
pub enum DatasetError {
    /// The system refused: missing, not readable, not text.
    #[error("{0}: cannot be read")]
    Read(PathBuf, #[source] std::io::Error),
    /// The system refused to write a file or folder.
    #[error("{0}: cannot be written: {1}")]
    Write(PathBuf, std::io::Error),
    /// A calibration that cannot be used.
    #[error("{0}: {1}")]
    Calibration(PathBuf, CalibrationError),
    /// A folder, file, line or field that is not what the format says: the path, and where they are known the line (from 1) and
    /// the name of the field; what should be there, and what is there.
    #[error("{0}")]
    Unexpected(String),
}

/// What reads or writes a data set gives.
pub type Result<T, E = DatasetError> = std::result::Result<T, E>;

impl DatasetError {
    /// A file or folder that cannot be read, from the system's answer.
    pub fn read(path: &Path) -> impl Fn(std::io::Error) -> DatasetError {
        |source| DatasetError::Read(path.to_owned(), source)
    }

    pub(super) fn write(path: &Path) -> impl Fn(std::io::Error) -> DatasetError {
        |cause| DatasetError::Write(path.to_owned(), cause)
    }

    pub(super) fn at(path: &Path, expected: impl Display, found: impl Display) -> DatasetError {
        DatasetError::unexpected(path.display(), expected, found)
    }

    /// Something in this place that is not what the format says.
    pub fn unexpected(place: impl Display, expected: impl Display, found: impl Display) -> Self {
        DatasetError::Unexpected(format!("{place}: expected {expected}, found {found}"))
    }
}

/// A line of a text file, for the faults in it.
#[derive(Clone, Copy)]
pub(super) struct Line<'a> {
    pub(super) path: &'a Path,
    /// From 0.
    pub(super) index: usize,
}

impl Line<'_> {
    pub(super) fn fault(self, expected: impl Display, found: impl Display) -> DatasetError {
        DatasetError::unexpected(self, expected, found)
    }

    pub(super) fn in_field(self, name: &str, expected: impl Display, text: &str) -> DatasetError {
        DatasetError::unexpected(format!("{self}, field {name}"), expected, quoted(text))
    }
}

impl Display for Line<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}, line {}", self.path.display(), self.index + 1)
    }
}

/// What was found, in quotation marks and not longer than a line of a message.
pub(super) fn quoted(text: &str) -> String {
    format!("'{}'", text.chars().take(40).collect::<String>())
}
