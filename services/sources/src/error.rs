//! What keeps a source from giving scans.

use std::path::PathBuf;

/// A source that cannot be used. What is wrong with single packets is counted instead.
#[derive(Debug, thiserror::Error)]
pub enum SourceError {
    /// A calibration that cannot be used.
    #[error("calibration: {field}: expected {expected}, found {found}")]
    Calibration {
        /// Where in the calibration.
        field: String,
        /// What it should hold.
        expected: String,
        /// What it holds.
        found: String,
    },
    /// Packets of no known sensor, or of another one than the calibration's.
    #[error("packets: expected {expected}, found {found}")]
    Sensor {
        /// What would be understood.
        expected: String,
        /// What came.
        found: String,
    },
    /// A file that is not of the format that it should be.
    #[error("{}: expected {expected}, found {found}", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// What would be understood.
        expected: String,
        /// What it holds.
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
    pub(crate) fn calibration(
        field: impl Into<String>,
        expected: impl ToString,
        found: impl ToString,
    ) -> SourceError {
        SourceError::Calibration {
            field: field.into(),
            expected: expected.to_string(),
            found: found.to_string(),
        }
    }

    pub(crate) fn io(place: impl ToString, cause: impl Into<std::io::Error>) -> SourceError {
        let (place, cause) = (place.to_string(), cause.into());
        SourceError::Io { place, cause }
    }
}
