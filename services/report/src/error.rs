//! What can be wrong with a report that is read again.

/// Errors of this crate.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum ReportError {
    /// Written by another version of the program.
    #[error(
        "report version {found}, expected {expected}: it was written by another mluc; run `mluc bench` again with this one"
    )]
    Version {
        /// What this build reads.
        expected: u32,
        /// What the file says.
        found: String,
    },
    /// The table of frames has another head.
    #[error("frames.csv: expected the columns `{expected}`, found `{found}`")]
    Columns {
        /// Head that this build writes.
        expected: String,
        /// Head of the file.
        found: String,
    },
    /// A line of the table of frames.
    #[error("frames.csv, line {line}: expected {expected}, found `{found}`")]
    Line {
        /// Counted from 1.
        line: usize,
        /// What should stand there.
        expected: &'static str,
        /// What stands there.
        found: String,
    },
    /// Too little to judge.
    #[error("{frames} measured frames: at least {expected} are needed for a judgement")]
    TooFew {
        /// Least number.
        expected: usize,
        /// Frames of the smaller report.
        frames: usize,
    },
}
