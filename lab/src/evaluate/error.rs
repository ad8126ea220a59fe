//! What can be wrong with an evaluation's inputs.

use crate::dataset::DatasetError;
use std::path::PathBuf;

/// Why detections cannot be judged.
#[derive(Debug, thiserror::Error)]
pub enum EvaluateError {
    /// A label, detection or calibration file.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// `--labels`, `--detections` and `--calib` do not come in equal numbers.
    #[error("expected as many {what} as --labels ({expected}), in the same order, found {found}")]
    Counts {
        /// The option.
        what: &'static str,
        /// Number of `--labels`.
        expected: usize,
        /// Number of it.
        found: usize,
    },
    /// Detections that are not there.
    #[error("{}: expected a folder of detection files or a file of JSON lines, found nothing", path.display())]
    NoDetections {
        /// Where they should be.
        path: PathBuf,
    },
    /// JSON lines are in the sensor frame, labels in the camera's: a calibration is needed.
    #[error("{}: JSON lines need the calibration of their frames: expected --calib DIR, found none", path.display())]
    NoCalibration {
        /// The JSON lines.
        path: PathBuf,
    },
    /// The system refused to read JSON lines.
    #[error("{}: cannot be read", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's answer.
        source: std::io::Error,
    },
    /// A line that is not what the schema says.
    #[error("{}, line {line}: {message}", path.display())]
    Line {
        /// The JSON lines.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// What was expected and found.
        message: String,
    },
    /// Detections of which none belongs to a labelled frame.
    #[error("{}: expected detections of frames in {}, found none (first here '{first}', first there '{labelled}')", detections.display(), labels.display())]
    NoCommonFrame {
        /// Where the detections are.
        detections: PathBuf,
        /// Where the labels are.
        labels: PathBuf,
        /// Name of the first frame with detections.
        first: String,
        /// Name of the first labelled frame.
        labelled: String,
    },
    /// An overlap that cannot be asked for.
    #[error("overlap of {class}: expected a number from 0 up to and without 1, found {found}")]
    Overlap {
        /// The class.
        class: String,
        /// The number.
        found: f64,
    },
    /// A class that is to be known and unknown.
    #[error(
        "{class}: expected a class that is either known (--iou, --classes) or unknown (--unknown), found it in both"
    )]
    KnownAndUnknown {
        /// The class.
        class: String,
    },
    /// An image that does not begin like a PNG.
    #[error("{}: expected a PNG image of known size, found something else", path.display())]
    Image {
        /// The image.
        path: PathBuf,
    },
}
