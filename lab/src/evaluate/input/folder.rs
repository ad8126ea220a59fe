//! A folder of detection files in KITTI's format, one a frame, beside the labels.

use super::{Input, Source, compare_names};
use crate::dataset::{Label, file_stems, read_detections, read_labels};
use crate::evaluate::{Detection, EvaluateError, Frame, Kind, UNKNOWN};

pub(super) fn read(source: &Source, input: &mut Input) -> Result<(), EvaluateError> {
    let labelled = file_stems(&source.labels, "txt", "label files (*.txt)")?;
    let detected = file_stems(&source.detections, "txt", "detection files (*.txt)")?;
    let names: Vec<&str> = detected.iter().map(String::as_str).collect();
    compare_names(source, &labelled, &names, input)?;
    for name in &labelled {
        let labels = read_labels(&source.labels.join(format!("{name}.txt")))?.into();
        let path = source.detections.join(format!("{name}.txt"));
        let lines = if path.is_file() {
            read_detections(&path)?
        } else {
            Vec::new()
        };
        let detections = lines.into_iter().map(detection).collect();
        input.frames.push(Frame { labels, detections });
    }
    Ok(())
}

/// The image box is the file's own; nothing is dropped.
fn detection(line: Label) -> Detection {
    let kind = if line.is(UNKNOWN) {
        Kind::Unknown
    } else {
        Kind::Known
    };
    Detection {
        kind,
        // The reader has seen to it that detections have a score.
        score: line.score.unwrap_or_default(),
        image_box_px: line.image_box_px,
        upright: line.camera_box.upright(),
        class: line.class,
    }
}
