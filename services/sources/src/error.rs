//! Errors that keep a source from giving scans.

use std::fmt::Display;

/// A source that cannot be used: the field or file, what was expected and what was found; or a path or address and the system's answer. Faults of
/// single packets are counted instead.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct SourceError(String);

impl SourceError {
    pub(crate) fn field(place: impl Display, expected: impl Display, found: impl Display) -> Self {
        SourceError(format!("{place}: expected {expected}, found {found}"))
    }

    pub(crate) fn io(place: impl Display, cause: impl Into<std::io::Error>) -> SourceError {
        SourceError(format!("{place}: {}", cause.into()))
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
