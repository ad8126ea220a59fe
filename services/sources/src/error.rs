//! What keeps a source from giving scans.

/// A source that cannot be used. What is wrong with single packets is counted instead.
#[derive(Debug, thiserror::Error)]
pub enum SourceError {
    /// A field of a file of points, of its layout, or of a calibration; a file of another format; packets of no known sensor, or of another one than
    /// the calibration's.
    #[error("{place}: expected {expected}, found {found}")]
    Unexpected {
        /// Which field, or the file.
        place: String,
        /// What would be understood.
        expected: String,
        /// What came.
        found: String,
    },
    /// A file or socket that the system refuses.
    #[error("{place}: {cause}")]
    Io {
        /// The file or address.
        place: String,
        /// The system's answer.
        cause: std::io::Error,
    },
}

impl SourceError {
    pub(crate) fn field(
        place: impl ToString,
        expected: impl ToString,
        found: impl ToString,
    ) -> SourceError {
        SourceError::Unexpected {
            place: place.to_string(),
            expected: expected.to_string(),
            found: found.to_string(),
        }
    }

    pub(crate) fn io(place: impl ToString, cause: impl Into<std::io::Error>) -> SourceError {
        let (place, cause) = (place.to_string(), cause.into());
        SourceError::Io { place, cause }
    }
}

/// The answer to what is not as expected.
pub(crate) fn refused<T>(
    place: impl ToString,
    expected: impl ToString,
    found: impl ToString,
) -> Result<T, SourceError> {
    Err(SourceError::field(place, expected, found))
}
