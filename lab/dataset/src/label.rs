//! Label and detection files: one object per line, 15 columns, in the camera frame.
//!
//! `type truncated occluded alpha left top right bottom height width length x y z rotation_y`, then, in labels, an
//! optional track id (a whole number; below 0 means none) and, in detections, the score (after a track id where there are 17 columns).

use super::{Result, error::Line, read_text};
use mluc_geometry::CameraBox;
use std::path::Path;

/// One labelled or detected object; the default is fully visible.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Label {
    /// Class as written in the file (`Car`, `DontCare`, ...).
    pub class: String,
    /// Share outside the image, 0..1; a level (0, 1, 2) in tracking data; -1 where unknown.
    pub truncated: f64,
    /// 0 visible, 1 partly, 2 largely occluded, 3 unknown; -1 where unset.
    pub occluded: i32,
    /// Viewing angle, rad.
    pub alpha_rad: f64,
    /// Left, top, right, bottom in the image, px.
    pub image_box_px: [f64; 4],
    /// Position, size and heading in the camera frame.
    pub camera_box: CameraBox,
    /// Detections only: confidence.
    pub score: Option<f64>,
    /// Detections of the pipeline only: probability that the object is of its kind. Not in any file.
    pub probability: Option<f64>,
    /// Track id: the same for the object in all scans of a drive.
    pub track: Option<u32>,
}

impl Label {
    /// Whether the class is `name`, whatever the case of its letters.
    pub fn is(&self, name: &str) -> bool {
        self.class.eq_ignore_ascii_case(name)
    }

    /// Whether the line only marks a region without labels: it has no 3D box.
    pub fn is_dont_care(&self) -> bool {
        self.is("DontCare")
    }
}

impl std::fmt::Display for Label {
    /// The line of a label file (15 columns), or of a detection file (16) where there is a score; a track id precedes the score.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} {:.2}", self.class, self.truncated)?;
        write!(f, " {} {:.4}", self.occluded, self.alpha_rad)?;
        for pixel in self.image_box_px {
            write!(f, " {pixel:.2}")?;
        }
        let b = &self.camera_box;
        for metres in b.size_hwl_m.iter().chain(&b.location_m) {
            write!(f, " {metres:.4}")?;
        }
        write!(f, " {:.6}", b.rotation_y_rad)?;
        self.track.map_or(Ok(()), |track| write!(f, " {track}"))?;
        self.score.map_or(Ok(()), |score| write!(f, " {score:.6}"))
    }
}

/// Names of the columns, in order, as KITTI's description gives them.
#[rustfmt::skip]
const COLUMNS: [&str; 15] = [
    "type", "truncated", "occluded", "alpha", "left", "top", "right", "bottom",
    "height", "width", "length", "x", "y", "z", "rotation_y",
];

/// Reads a label file. An empty file is a frame without objects. A 16th column is a track id.
pub fn read_labels(path: &Path) -> Result<Vec<Label>> {
    parse(path, &read_text(path)?, false)
}

/// Reads a detection file: the format of a label file, with the score as the last column (16, or 17 after a track id).
pub fn read_detections(path: &Path) -> Result<Vec<Label>> {
    parse(path, &read_text(path)?, true)
}

fn parse(path: &Path, text: &str, scored: bool) -> Result<Vec<Label>> {
    let lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    lines
        .map(|(index, line)| {
            let columns: Vec<&str> = line.split_whitespace().collect();
            label(Line { path, index }, &columns, scored)
        })
        .collect()
}

fn label(line: Line<'_>, columns: &[&str], scored: bool) -> Result<Label> {
    check_count(line, columns.len(), scored)?;
    let number = |column: usize, field: &str| {
        let number = columns[column].parse::<f64>().ok();
        let number = number.filter(|v| v.is_finite());
        number.ok_or_else(|| line.in_field(field, "a finite number", columns[column]))
    };
    let mut numbers = [0.0; 15];
    for i in 1..15 {
        numbers[i] = number(i, COLUMNS[i])?;
    }
    if let Some((column, expected)) = fault(&numbers, columns[0], scored) {
        return Err(line.in_field(COLUMNS[column], expected, columns[column]));
    }
    let three = |first: usize| [0, 1, 2].map(|i| numbers[first + i]);
    let whole = |track: &&str| {
        let expected = "a whole number (a score is the last column of detections)";
        track.parse::<i64>().map_err(|_| line.in_field("track", expected, track))
    };
    let track = columns[15..columns.len() - usize::from(scored)].first().map(whole).transpose()?;
    let score = scored.then(|| number(columns.len() - 1, "score"));
    Ok(Label {
        class: columns[0].to_owned(),
        truncated: numbers[1],
        occluded: numbers[2] as i32,
        alpha_rad: numbers[3],
        image_box_px: [4, 5, 6, 7].map(|i| numbers[i]),
        camera_box: CameraBox {
            size_hwl_m: three(8),
            location_m: three(11),
            rotation_y_rad: numbers[14],
        },
        score: score.transpose()?,
        probability: None,
        track: track.and_then(|track| u32::try_from(track).ok()),
    })
}

fn check_count(line: Line<'_>, found: usize, scored: bool) -> Result<()> {
    let least = if scored { 16 } else { 15 };
    if (least..=least + 1).contains(&found) {
        return Ok(());
    }
    let mut names = COLUMNS.iter().chain(scored.then_some(&"score"));
    let missing = names.nth(found).map(|name| format!(" (no {name})"));
    let found = format!("{found}{}", missing.unwrap_or_default());
    Err(line.fault(format!("{least} or {} columns", least + 1), found))
}

/// The first column with a number that is not valid for an object, and what was expected there.
fn fault(numbers: &[f64; 15], class: &str, scored: bool) -> Option<(usize, &'static str)> {
    let has_box = if scored {
        // KITTI's marker for a detection without a 3D box.
        numbers[8..11] != [-1.0; 3]
    } else {
        !class.eq_ignore_ascii_case("DontCare")
    };
    let expected = |column: usize| {
        let v = numbers[column];
        match column {
            2 if v.fract() != 0.0 || !(-1.0..=1000.0).contains(&v) => {
                Some("a whole number (0 to 3, -1 unset)")
            }
            8..11 if scored && has_box && v <= 0.0 => {
                Some("a size above 0 (-1 in all three: none)")
            }
            8..11 if !scored && has_box && !(0.01..=100.0).contains(&v) => {
                Some("a size of 0.01 to 100 m")
            }
            11..14 if !scored && has_box && v.abs() > 10_000.0 => Some("a place within 10 km"),
            _ => None,
        }
    };
    (0..15).find_map(|column| Some((column, expected(column)?)))
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAR: &str = "Car 0.00 1 -1.57 100.0 110.5 200 210 1.5 1.6 3.9 1.0 1.7 20.0 -1.6";

    fn parsed(text: &str, scored: bool) -> Result<Vec<Label>, String> {
        parse(Path::new("a.txt"), text, scored).map_err(|e| e.to_string())
    }

    #[test]
    fn reads_labels_with_and_without_a_track_id() {
        let text = format!("{CAR}\n\n{CAR} 7\n{CAR} -1\n");
        let labels = parsed(&text, false).expect("labels");
        let tracks = labels.iter().map(|label| label.track);
        assert!(tracks.eq([None, Some(7), None]));
        let car = &labels[0];
        assert!(car.is("car") && !car.is_dont_care());
        let found = (car.occluded, car.truncated, car.alpha_rad, car.score);
        assert_eq!(found, (1, 0.0, -1.57, None));
        assert_eq!(car.image_box_px, [100.0, 110.5, 200.0, 210.0]);
        assert_eq!(car.camera_box.size_hwl_m, [1.5, 1.6, 3.9]);
        assert_eq!(car.camera_box.location_m, [1.0, 1.7, 20.0]);
        assert_eq!(car.camera_box.rotation_y_rad, -1.6);
        assert!(parsed("", false).expect("no objects").is_empty());
    }

    #[test]
    fn a_written_line_reads_back() {
        let mut car = parsed(CAR, false).expect("label").remove(0);
        (car.score, car.track) = (Some(0.75), Some(3));
        let back = parsed(&car.to_string(), true).expect("detection");
        assert_eq!(back, vec![car]);
    }

    /// Kind of file, text of the file (without the car on line 1), error.
    const FAULTS: &str = include_str!("label_faults.txt");

    #[test]
    fn faults_name_line_field_expected_and_found() {
        for row in FAULTS.lines() {
            let [kind, text, expected] = row.split('|').collect::<Vec<_>>()[..] else {
                panic!("{row}");
            };
            let scored = kind == "score";
            let score = if scored { " 1" } else { "" };
            let text = format!("{CAR}{score}\n{}", text.replace("CAR", CAR));
            let fault = parsed(&text, scored).expect_err(row);
            let is_field = expected.starts_with("field");
            let place = if is_field { ", " } else { ": " };
            assert_eq!(fault, format!("a.txt, line 2{place}{expected}"));
        }
        let boxless = CAR.replace("1.5 1.6 3.9", "-1 -1 -1") + " 0.5";
        assert!(parsed(&boxless, true).is_ok());
        let region = "DontCare -1 -1 -10 0 0 9 9 -1 -1 -1 -1000 -1000 -1000 -10";
        assert!(parsed(region, false).is_ok());
    }
}
