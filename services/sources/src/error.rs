//! Errors that keep a source from giving scans.

use std::fmt::Display;

/// A source that cannot be used. Faults of single packets are counted instead.
#[derive(Debug, thiserror::Error)]
pub enum SourceError {
    /// The field or file, what was expected and what was found. Causes: a field of a file of points, of its layout or of a calibration; a file of
    /// another format; packets of no known sensor, or of another sensor than the calibration's.
    #[error("{0}")]
    Unexpected(String),
    /// A file or socket that the system refuses: its path or address, and the system's answer.
    #[error("{0}: {1}")]
    Io(String, std::io::Error),
}

impl SourceError {
    pub(crate) fn field(place: impl Display, expected: impl Display, found: impl Display) -> Self {
        SourceError::Unexpected(format!("{place}: expected {expected}, found {found}"))
    }

    pub(crate) fn io(place: impl Display, cause: impl Into<std::io::Error>) -> SourceError {
        SourceError::Io(place.to_string(), cause.into())
    }
}

/// The error for a value that is not as expected.
pub(crate) fn refused<T>(
    place: impl Display,
    expected: impl Display,
    found: impl Display,
) -> Result<T, SourceError> {
    Err(SourceError::field(place, expected, found))
}
