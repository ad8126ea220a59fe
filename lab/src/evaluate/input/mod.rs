//! From folders and files to frames.
//!
//! A source is a folder of labels with the detections that belong to it: a folder of detection files of the same
//! names, or one file of JSON lines with the folder of calibrations that brings its boxes into the camera frame.
//! Several sources are pooled: the same name in two of them is two frames.

mod folder;
mod image;
mod json_lines;

pub(crate) use image::size_beside as image_size_beside;
pub use json_lines::read_json_lines;

use super::{EvaluateError, Frame};
use mluc_geometry::ImageSize;
use std::path::{Path, PathBuf};

/// One folder of labels and what was detected there.
#[derive(Clone, Debug)]
pub struct Source {
    /// Folder of label files. Its frames are the ones that are judged.
    pub labels: PathBuf,
    /// Folder of detection files, or a file of JSON lines.
    pub detections: PathBuf,
    /// Folder of calibration files; JSON lines need it.
    pub calibration: Option<PathBuf>,
}

/// The frames of all sources.
#[derive(Clone, Debug, Default)]
pub struct Input {
    /// By source, then by name.
    pub frames: Vec<Frame>,
    /// What a person should know before believing the figures.
    pub warnings: Vec<String>,
}

/// Pairs the options of a command: as many detections as labels, as many calibrations or none.
pub fn sources(
    labels: &[PathBuf],
    detections: &[PathBuf],
    calibrations: &[PathBuf],
) -> Result<Vec<Source>, EvaluateError> {
    let expected = labels.len();
    for (what, found, optional) in [
        ("--detections", detections.len(), false),
        ("--calib", calibrations.len(), true),
    ] {
        if found != expected && !(optional && found == 0) {
            return Err(EvaluateError::Counts {
                what,
                expected,
                found,
            });
        }
    }
    let pairs = labels.iter().zip(detections).enumerate();
    Ok(pairs
        .map(|(i, (labels, detections))| Source {
            labels: labels.clone(),
            detections: detections.clone(),
            calibration: calibrations.get(i).cloned(),
        })
        .collect())
}

/// Reads every source. Frames without detections count with none found, and are warned about; so are detections of
/// frames that have no labels, which are left out. A source whose detections all lie elsewhere is an error.
/// `image` overrides the size of the images beside the labels.
pub fn read(sources: &[Source], image: Option<ImageSize>) -> Result<Input, EvaluateError> {
    let mut input = Input::default();
    for source in sources {
        let detections = &source.detections;
        if detections.is_dir() {
            folder::read(source, &mut input)?;
        } else if detections.exists() {
            json_lines::read(source, image, &mut input)?;
        } else {
            return Err(EvaluateError::NoDetections {
                path: detections.clone(),
            });
        }
    }
    Ok(input)
}

/// Checks that labels and detections share frames, and says what only one of them has. Both lists are sorted.
fn compare_names(
    source: &Source,
    labelled: &[String],
    detected: &[&str],
    input: &mut Input,
) -> Result<(), EvaluateError> {
    let missing: Vec<&str> = labelled
        .iter()
        .map(String::as_str)
        .filter(|name| detected.binary_search(name).is_err())
        .collect();
    let foreign: Vec<&str> = detected
        .iter()
        .copied()
        .filter(|name| labelled.binary_search_by(|l| l.as_str().cmp(name)).is_err())
        .collect();
    if missing.len() == labelled.len() {
        return Err(EvaluateError::NoCommonFrame {
            detections: source.detections.clone(),
            labels: source.labels.clone(),
            first: detected.first().copied().unwrap_or_default().to_owned(),
            labelled: labelled.first().cloned().unwrap_or_default(),
        });
    }
    let mut warn = |names: &[&str], what: &str, path: &Path| {
        if let Some(first) = names.first() {
            let count = names.len();
            input.warnings.push(format!(
                "{}: {count} frames {what} (first: {first})",
                path.display()
            ));
        }
    };
    warn(
        &missing,
        "have labels but no detections: counted with nothing found",
        &source.detections,
    );
    warn(
        &foreign,
        "have detections but no labels: left out",
        &source.labels,
    );
    Ok(())
}
