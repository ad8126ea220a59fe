//! Errors in a data set.

use mluc_geometry::CalibrationError;
use std::{fmt::Display, path::Path, path::PathBuf};

/// An error in a folder or file of a data set: where it is, what was expected, what was found.
#[derive(Debug, thiserror::Error)]
pub enum DatasetError {
    /// The system could not read it: missing, not readable, not text.
    #[error("{0}: cannot be read")]
    Read(PathBuf, #[source] std::io::Error),
    /// The system could not write a file or folder.
    #[error("{0}: cannot be written: {1}")]
    Write(PathBuf, std::io::Error),
    /// A calibration that cannot be used.
    #[error("{0}: {1}")]
    Calibration(PathBuf, CalibrationError),
    /// A folder, file, line or field that does not match the format: the path, the line (from 1) and the field's name where they
    /// are known, what was expected, and what was found.
    #[error("{0}")]
    Unexpected(String),
}

/// Result of reading or writing a data set.
pub type Result<T, E = DatasetError> = std::result::Result<T, E>;

impl DatasetError {
    /// The error for a file or folder that cannot be read, from the system's error.
    pub fn read(path: &Path) -> impl Fn(std::io::Error) -> DatasetError {
        |source| DatasetError::Read(path.to_owned(), source)
    }

    pub(super) fn write(path: &Path) -> impl Fn(std::io::Error) -> DatasetError {
        |cause| DatasetError::Write(path.to_owned(), cause)
    }

    pub(super) fn at(path: &Path, expected: impl Display, found: impl Display) -> DatasetError {
        DatasetError::unexpected(path.display(), expected, found)
    }

    /// The error for something at `place` that does not match the format.
    pub fn unexpected(place: impl Display, expected: impl Display, found: impl Display) -> Self {
        DatasetError::Unexpected(format!("{place}: expected {expected}, found {found}"))
    }
}

/// A line of a text file, for errors in it.
#[derive(Clone, Copy)]
pub(super) struct Line<'a> {
    pub(super) path: &'a Path,
    /// Index of the line, from 0.
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

/// The text that was found, in quotation marks, cut to the length of one message line.
pub(super) fn quoted(text: &str) -> String {
    format!("'{}'", text.chars().take(40).collect::<String>())
}
