//! The pipeline's JSON lines: one frame per line, objects in the sensor frame.
//!
//! Only the fields that are evaluated are read: `frame`, and the kind, label, score and box of each of `objects`. Others are skipped.

use crate::{EvaluateError, Result, SensorDetection};
use mluc_ipc_types::{FrameHeader, WIRE_VERSION};
use serde::{Deserialize, de::IgnoredAny};
use std::io::{BufRead, BufReader, Read};
use std::{collections::BTreeMap, path::Path};

/// Maximum length of a line, bytes: about twenty times 512 objects with footprints.
const LINE_BYTES_MAX: u64 = 8 << 20;

#[derive(Deserialize)]
struct Line {
    /// Lines of other tools may omit it.
    wire: Option<u32>,
    frame: String,
    objects: Vec<SensorDetection>,
}

/// The lines that `mluc up --status-lines` writes between the frames.
#[derive(Deserialize)]
struct StatusLine {
    #[serde(rename = "status")]
    _status: IgnoredAny,
}

/// Reads JSON lines: detections by frame name. A repeated frame is an error, and so is a truncated line.
pub fn read_json_lines(path: &Path) -> Result<BTreeMap<String, Vec<SensorDetection>>> {
    let failed = |e| EvaluateError::file(path, e);
    let mut reader = BufReader::new(std::fs::File::open(path).map_err(failed)?);
    let mut frames = BTreeMap::new();
    let mut bytes = Vec::new();
    for number in 1.. {
        bytes.clear();
        let fault = |message: String| {
            EvaluateError::Input(format!("{}, line {number}: {message}", path.display()))
        };
        let mut limited = reader.by_ref().take(LINE_BYTES_MAX + 1);
        let count = limited.read_until(b'\n', &mut bytes).map_err(failed)?;
        if count == 0 {
            break;
        }
        if count as u64 > LINE_BYTES_MAX {
            let expected = format!("expected at most {LINE_BYTES_MAX} bytes a line, found more");
            return Err(fault(expected));
        }
        if bytes.trim_ascii().is_empty() {
            continue;
        }
        let line = match parse(&bytes) {
            Err(_) if serde_json::from_slice::<StatusLine>(&bytes).is_ok() => continue,
            line => line.map_err(&fault)?,
        };
        // Cut to the length that a header allows.
        let name = FrameHeader::cut(&line.frame);
        if frames.contains_key(name) {
            let expected = "field frame: expected each frame once";
            return Err(fault(format!("{expected}, found '{}' again", line.frame)));
        }
        frames.insert(name.to_owned(), line.objects);
    }
    Ok(frames)
}

/// Errors of a line alone; the caller adds the location.
fn parse(bytes: &[u8]) -> Result<Line, String> {
    let line: Line = serde_json::from_slice(bytes).map_err(|e| e.to_string())?;
    if let Some(found) = line.wire.filter(|&wire| wire != WIRE_VERSION) {
        let what = format!("field wire: expected {WIRE_VERSION}, found {found}");
        return Err(what);
    }
    let mut sizes = line.objects.iter().flat_map(|o| o.box_in_sensor.size_m);
    match sizes.find(|v| !(v.is_finite() && *v > 0.0)) {
        Some(found) => Err(format!("field size_m: expected sizes above 0, found {found}")),
        None => Ok(line),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mluc_geometry::Box3;

    const LINE: &str = r#"{"wire":WIRE,"sequence":8,"frame":"000008","objects":[{"kind":"unknown","label":"unknown","score":0.5,"center_m":[10,1,-1],"size_m":[4,2,1.5],"yaw_rad":0.1,"points":9}],"suppressed":[{"reason":"overlaps_known"}],"flags":[]}"#;

    /// A valid line of this version.
    fn good() -> String {
        LINE.replace("WIRE", &WIRE_VERSION.to_string())
    }

    fn read_text(text: &str) -> Result<BTreeMap<String, Vec<SensorDetection>>, String> {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("o.jsonl");
        std::fs::write(&path, text).expect("written");
        let name = folder.path().display().to_string();
        read_json_lines(&path).map_err(|e| e.to_string().replace(&name, ""))
    }

    #[test]
    fn takes_objects_and_passes_over_the_rest() {
        let good = good();
        let frames = read_text(&format!("{good}\n{{\"status\":{{\"state\":\"blind\"}}}}\n\n"))
            .expect("a frame");
        let place = Box3::new([10.0, 1.0, -1.0, 4.0, 2.0, 1.5, 0.1]);
        assert_eq!(frames["000008"], [SensorDetection::unknown(0.5, place)]);
        assert!(read_text("").expect("nothing").is_empty());
    }

    #[test]
    fn faults_name_line_and_field() {
        let good = good();
        for line in include_str!("faulty_lines.txt").lines() {
            let [whole, broken, expected] = line.split(" | ").collect::<Vec<_>>()[..] else {
                panic!("{line}");
            };
            let expected = expected.replace("WIRE", &WIRE_VERSION.to_string());
            let line = LINE.replace(whole, broken).replace("WIRE", &WIRE_VERSION.to_string());
            let fault = read_text(&format!("{good}\n{line}")).expect_err(&expected);
            assert!(fault.contains(&expected), "{fault}");
        }
        let fault = read_text(&format!("{good}\n{}", &good[..60]));
        assert!(fault.is_err_and(|fault| fault.contains("line 2: EOF")));
    }
}
