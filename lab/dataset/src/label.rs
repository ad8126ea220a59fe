//! Label and detection files: one object a line, 15 columns, in the camera frame.
//!
//! `type truncated occluded alpha left top right bottom height width length x y z rotation_y`, then, in labels, an
//! optional track id and, in detections, the score (after a track id when there are 17 columns).

use super::{DatasetError, read_text};
use mluc_geometry::CameraBox;
use std::path::Path;

/// One labelled or detected object.
#[derive(Clone, Debug, PartialEq)]
pub struct Label {
    /// Class as written in the file (`Car`, `DontCare`, ...).
    pub class: String,
    /// Part outside the image, 0..1; a level (0, 1, 2) in tracking data; -1 where unknown.
    pub truncated: f64,
    /// 0 visible, 1 partly, 2 largely occluded, 3 unknown; -1 where unset.
    pub occluded: i32,
    /// Viewing angle, rad.
    pub alpha_rad: f64,
    /// Left, top, right, bottom in the image, px.
    pub image_box_px: [f64; 4],
    /// Place, size and heading in the camera frame.
    pub camera_box: CameraBox,
    /// Detections only: confidence.
    pub score: Option<f64>,
}

impl Label {
    /// Whether the class is `name`, whatever the case of its letters.
    pub fn is(&self, name: &str) -> bool {
        self.class.eq_ignore_ascii_case(name)
    }

    /// Whether the line only marks a region without labels: it has no box in space.
    pub fn is_dont_care(&self) -> bool {
        self.is("DontCare")
    }
}

impl std::fmt::Display for Label {
    /// The line of a label file (15 columns), or of a detection file (16) when there is a score.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [left, top, right, bottom] = self.image_box_px;
        let CameraBox {
            location_m: [x, y, z],
            size_hwl_m: [h, w, l],
            rotation_y_rad,
        } = self.camera_box;
        write!(
            f,
            "{} {:.2} {} {:.4}",
            self.class, self.truncated, self.occluded, self.alpha_rad
        )?;
        write!(f, " {left:.2} {top:.2} {right:.2} {bottom:.2}")?;
        write!(
            f,
            " {h:.4} {w:.4} {l:.4} {x:.4} {y:.4} {z:.4} {rotation_y_rad:.6}"
        )?;
        self.score.map_or(Ok(()), |score| write!(f, " {score:.6}"))
    }
}

/// Names of the columns, in order, as KITTI's description gives them.
#[rustfmt::skip]
const COLUMNS: [&str; 15] = [
    "type", "truncated", "occluded", "alpha", "left", "top", "right", "bottom",
    "height", "width", "length", "x", "y", "z", "rotation_y",
];

/// Sizes and places that a labelled object can have.
const SIZE_M: std::ops::RangeInclusive<f64> = 0.01..=100.0;
const PLACE_M: std::ops::RangeInclusive<f64> = -10_000.0..=10_000.0;

/// Reads a label file. An empty file is a frame without objects. A 16th column (a track id) is passed over.
pub fn read_labels(path: &Path) -> Result<Vec<Label>, DatasetError> {
    parse(path, &read_text(path)?, false)
}

/// Reads a detection file: as a label file, with the score as the last column (16, or 17 after a track id).
pub fn read_detections(path: &Path) -> Result<Vec<Label>, DatasetError> {
    parse(path, &read_text(path)?, true)
}

fn parse(path: &Path, text: &str, scored: bool) -> Result<Vec<Label>, DatasetError> {
    let lines = text
        .lines()
        .enumerate()
        .filter(|(_, line)| !line.trim().is_empty());
    lines
        .map(|(index, line)| {
            Line {
                path,
                line: index + 1,
                columns: line.split_whitespace().collect(),
            }
            .label(scored)
        })
        .collect()
}

/// One line with what its errors must name.
struct Line<'a> {
    path: &'a Path,
    line: usize,
    columns: Vec<&'a str>,
}

impl Line<'_> {
    fn label(&self, scored: bool) -> Result<Label, DatasetError> {
        self.check_count(scored)?;
        let mut numbers = [0.0; 15];
        for (i, number) in numbers.iter_mut().enumerate().skip(1) {
            *number = self.number(i, COLUMNS[i])?;
        }
        let [
            _,
            truncated,
            occluded,
            alpha_rad,
            left,
            top,
            right,
            bottom,
            h,
            w,
            l,
            x,
            y,
            z,
            rotation_y_rad,
        ] = numbers;
        if occluded.fract() != 0.0 || !(-1.0..=1000.0).contains(&occluded) {
            return Err(self.fault(
                "occluded",
                "a whole number (0 to 3, -1 unset)",
                self.columns[2],
            ));
        }
        let mut score = None;
        if scored {
            self.check_found(&numbers)?;
            score = Some(self.number(self.columns.len() - 1, "score")?);
        } else if !self.columns[0].eq_ignore_ascii_case("DontCare") {
            self.check_box(&numbers)?;
        }
        Ok(Label {
            class: self.columns[0].to_owned(),
            truncated,
            occluded: occluded as i32,
            alpha_rad,
            image_box_px: [left, top, right, bottom],
            camera_box: CameraBox {
                location_m: [x, y, z],
                size_hwl_m: [h, w, l],
                rotation_y_rad,
            },
            score,
        })
    }

    /// Whether a labelled box can be an object's.
    fn check_box(&self, numbers: &[f64; 15]) -> Result<(), DatasetError> {
        let ranges = [
            (8..11, SIZE_M, "a size of 0.01 to 100 m"),
            (11..14, PLACE_M, "a place within 10 km"),
        ];
        for (columns, range, expected) in ranges {
            let mut columns = columns;
            if let Some(i) = columns.find(|i| !range.contains(&numbers[*i])) {
                return Err(self.fault(COLUMNS[i], expected, self.columns[i]));
            }
        }
        Ok(())
    }

    /// Sizes of a detection are above 0, or all -1 where it has no box in space (KITTI's word for it).
    fn check_found(&self, numbers: &[f64; 15]) -> Result<(), DatasetError> {
        let sizes = &numbers[8..11];
        match sizes.iter().position(|size| *size <= 0.0) {
            Some(i) if sizes != [-1.0; 3] => {
                let expected = "a size above 0 (-1 in all three: none)";
                Err(self.fault(COLUMNS[8 + i], expected, self.columns[8 + i]))
            }
            _ => Ok(()),
        }
    }

    fn check_count(&self, scored: bool) -> Result<(), DatasetError> {
        let found = self.columns.len();
        let (range, expected) = if scored {
            (16..=17, "16 or 17")
        } else {
            (15..=16, "15 or 16")
        };
        if range.contains(&found) {
            return Ok(());
        }
        let missing = COLUMNS
            .get(found)
            .copied()
            .unwrap_or(if scored && found == 15 { "score" } else { "" });
        Err(DatasetError::Columns {
            path: self.path.to_owned(),
            line: self.line,
            expected,
            found,
            missing,
        })
    }

    fn number(&self, column: usize, field: &'static str) -> Result<f64, DatasetError> {
        let text = self.columns[column];
        let number = text.parse::<f64>().ok().filter(|v| v.is_finite());
        number.ok_or_else(|| self.fault(field, "a finite number", text))
    }

    fn fault(&self, field: &'static str, expected: &'static str, found: &str) -> DatasetError {
        let found = found.chars().take(40).collect();
        DatasetError::Field {
            path: self.path.to_owned(),
            line: self.line,
            field,
            expected,
            found,
        }
    }
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
        let labels = parsed(&format!("{CAR}\n\n{CAR} 7\n"), false).expect("labels");
        assert_eq!(labels.len(), 2);
        assert_eq!(labels[0], labels[1]);
        let car = &labels[0];
        assert!(car.is("car") && !car.is_dont_care());
        assert_eq!(
            (car.occluded, car.truncated, car.alpha_rad, car.score),
            (1, 0.0, -1.57, None)
        );
        assert_eq!(car.image_box_px, [100.0, 110.5, 200.0, 210.0]);
        assert_eq!(car.camera_box.size_hwl_m, [1.5, 1.6, 3.9]);
        assert_eq!(car.camera_box.location_m, [1.0, 1.7, 20.0]);
        assert!(parsed("", false).expect("no objects").is_empty());
    }

    #[test]
    fn reads_scores() {
        let detections = parsed(&format!("{CAR} 0.5\n{CAR} 3 -0.25"), true).expect("detections");
        assert_eq!(detections[0].score, Some(0.5));
        assert_eq!(detections[1].score, Some(-0.25));
    }

    #[test]
    fn a_written_line_reads_back() {
        let mut car = parsed(CAR, false).expect("label").remove(0);
        car.score = Some(0.75);
        assert_eq!(
            parsed(&car.to_string(), true).expect("detection"),
            vec![car]
        );
    }

    #[test]
    fn faults_name_line_field_expected_and_found() {
        let short = parsed(&format!("{CAR}\nCar 0.00 1 -1.57 100"), false).expect_err("short");
        assert_eq!(
            short,
            "a.txt, line 2: expected 15 or 16 columns, found 5 (no top)"
        );
        let unscored = parsed(CAR, true).expect_err("no score");
        assert_eq!(
            unscored,
            "a.txt, line 1: expected 16 or 17 columns, found 15 (no score)"
        );
        let word = parsed(&CAR.replace("20.0", "far"), false).expect_err("word");
        assert_eq!(
            word,
            "a.txt, line 1, field z: expected a finite number, found 'far'"
        );
        let nan = parsed(&format!("{CAR} nan"), true).expect_err("nan");
        assert_eq!(
            nan,
            "a.txt, line 1, field score: expected a finite number, found 'nan'"
        );
        let negative = parsed(&CAR.replace("3.9", "-3.9"), false).expect_err("negative");
        assert_eq!(
            negative,
            "a.txt, line 1, field length: expected a size of 0.01 to 100 m, found '-3.9'"
        );
        let far = parsed(&CAR.replace("20.0", "1e30"), false).expect_err("far");
        assert!(
            far.contains("field z: expected a place within 10 km"),
            "{far}"
        );
        let found = parsed(&format!("{} 0.5", CAR.replace("3.9", "-3.9")), true);
        assert!(
            found
                .expect_err("negative")
                .contains("field length: expected a size above 0")
        );
        let flat = format!("{} 0.5", CAR.replace("1.5 1.6 3.9", "-1 -1 -1"));
        assert!(parsed(&flat, true).is_ok());
        let region = "DontCare -1 -1 -10 0 0 9 9 -1 -1 -1 -1000 -1000 -1000 -10";
        assert!(parsed(region, false).is_ok());
        let half = parsed(&CAR.replace(" 1 -1.57", " 0.5 -1.57"), false).expect_err("half");
        assert!(half.contains("field occluded"), "{half}");
        let long = parsed(&format!("{CAR} 1 2 3"), false).expect_err("long");
        assert_eq!(long, "a.txt, line 1: expected 15 or 16 columns, found 18");
    }
}
