//! The network's boxes of every Nth frame in a file: many jobs run the network, and one job evaluates all boxes.
//!
//! A part is a line of JSON, [`Contents`], followed by the boxes in their memory layout.

use super::{DetectedFrame, FrameSet};
use crate::{EvaluateError, Result};
use mluc_backbone::Precision;
use mluc_dataset::whole_file::write_whole;
use mluc_head::Detection;
use mluc_ipc_types::WIRE_VERSION;
use mluc_model::Model;
use serde::{Deserialize, Serialize};
use std::{collections::BTreeMap, path::Path, path::PathBuf};

/// Contents of a part; the first two fields must be equal in all parts.
#[derive(Serialize, Deserialize)]
struct Contents {
    /// Version of the boxes' layout.
    wire: u32,
    /// The model's fingerprint, 16 hexadecimal digits, and the precision.
    made_with: String,
    /// Name and number of boxes of each frame.
    frames: Vec<(String, usize)>,
}

fn made_with(model: &Model, precision: Precision) -> String {
    format!("{:016x} {precision}", model.fingerprint)
}

/// Writes one part: the frames of a subset.
pub fn write_part(
    path: &Path,
    model: &Model,
    precision: Precision,
    set: &FrameSet,
    frames: &[DetectedFrame],
) -> Result<()> {
    let entries = set.names().iter().zip(frames);
    let entries = entries.map(|(name, frame)| (name.clone(), frame.detections.len()));
    let contents = Contents {
        wire: WIRE_VERSION,
        made_with: made_with(model, precision),
        frames: entries.collect(),
    };
    let head = serde_json::to_string(&contents).map_err(|e| EvaluateError::file(path, e))? + "\n";
    let mut bytes = head.into_bytes();
    for frame in frames {
        bytes.extend_from_slice(bytemuck::cast_slice(&frame.detections));
    }
    let written = write_whole(path, &bytes);
    written.map_err(|cause| EvaluateError::file(path, format!("cannot be written: {cause}")))
}

/// The frames of a set from its parts: each frame in exactly one part, and no other frames. They equal those of [`super::detect_frames`] bit for bit.
pub fn read_parts(
    paths: &[PathBuf],
    model: &Model,
    precision: Precision,
    set: &FrameSet,
) -> Result<Vec<DetectedFrame>> {
    let mut found = BTreeMap::new();
    for path in paths {
        for (name, boxes) in read_part(path, &made_with(model, precision))? {
            if found.insert(name.clone(), boxes).is_some() {
                let what = format!("frame {name}: expected in one part, found in another one too");
                return Err(EvaluateError::file(path, what));
            }
        }
    }
    let frame = |(index, name): (usize, &String)| {
        let missing = || format!("frame {name}: expected in one of the parts, found in none");
        let detections = (found.remove(name)).ok_or_else(|| EvaluateError::Input(missing()))?;
        let truth = set.truth(index)?;
        Ok(DetectedFrame { truth, detections })
    };
    let frames: Result<Vec<_>> = set.names().iter().enumerate().map(frame).collect();
    let frames = frames?;
    match found.first_key_value() {
        None => Ok(frames),
        Some((name, _)) => Err(EvaluateError::Input(format!(
            "frame {name} of the parts: expected in the data, found none of this name"
        ))),
    }
}

fn read_part(path: &Path, expected: &str) -> Result<Vec<(String, Vec<Detection>)>> {
    let fault = |what: String| EvaluateError::file(path, what);
    let bytes = std::fs::read(path).map_err(|cause| fault(cause.to_string()))?;
    let end = bytes.iter().position(|byte| *byte == b'\n');
    let (head, mut rest) = bytes.split_at(end.map_or(0, |end| end + 1));
    let none = |_| fault("expected what --write-part writes, found another file".to_owned());
    let contents: Contents = serde_json::from_slice(head).map_err(none)?;
    let found = (contents.wire, contents.made_with.as_str());
    if found != (WIRE_VERSION, expected) {
        return Err(fault(format!(
            "expected boxes of wire version {WIRE_VERSION}, model and precision {expected}, found {} and {}",
            found.0, found.1
        )));
    }
    let mut frames = Vec::new();
    for (name, count) in contents.frames {
        let size = count.checked_mul(size_of::<Detection>());
        let Some((boxes, behind)) = size.and_then(|size| rest.split_at_checked(size)) else {
            let left = rest.len();
            let what = format!("frame {name}: expected {count} boxes, found {left} bytes");
            return Err(fault(what));
        };
        let boxes = boxes.chunks_exact(size_of::<Detection>());
        let boxes = boxes.map(bytemuck::pod_read_unaligned).collect();
        frames.push((name, boxes));
        rest = behind;
    }
    if rest.is_empty() {
        return Ok(frames);
    }
    let what = format!("expected no bytes behind the frames, found {}", rest.len());
    Err(fault(what))
}
