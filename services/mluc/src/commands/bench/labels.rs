//! Labels beside the scans, in KITTI's layout: `label_2/NAME.txt`, `calib/NAME.txt`.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use mluc_geometry::{Box3, Calibration, CameraBox};

/// A labelled object in the sensor frame.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Label {
    pub(super) class: String,
    pub(super) box_in_sensor: Box3,
}

/// Where labels lie; `None`: there are none.
pub(super) struct Labels(Option<PathBuf>);

impl Labels {
    /// `input`: a folder with `velodyne/`, that folder itself, or a scan in it.
    pub(super) fn beside(input: &Path) -> Labels {
        let root = input
            .ancestors()
            .take(3)
            .find(|folder| folder.join("label_2").is_dir());
        Labels(root.map(Path::to_path_buf))
    }

    /// Of a frame; `None`: it has no labels.
    pub(super) fn of(&self, frame: &str) -> anyhow::Result<Option<Vec<Label>>> {
        let Some(root) = &self.0 else {
            return Ok(None);
        };
        let path = root.join(format!("label_2/{frame}.txt"));
        let Ok(text) = fs::read_to_string(&path) else {
            return Ok(None);
        };
        let calibration = match fs::read_to_string(root.join(format!("calib/{frame}.txt"))) {
            Ok(text) => calibration(&text).with_context(|| format!("calibration of {frame}"))?,
            Err(_) => Calibration::without_camera(),
        };
        let labels = text
            .lines()
            .filter(|line| !line.trim().is_empty())
            .map(|line| label(line, &calibration));
        let labels: Vec<Option<Label>> = labels
            .collect::<anyhow::Result<_>>()
            .with_context(|| format!("labels {}", path.display()))?;
        Ok(Some(labels.into_iter().flatten().collect()))
    }
}

/// `class truncated occluded alpha left top right bottom height width length x y z rotation_y`; `None`: a region without
/// a box.
fn label(line: &str, calibration: &Calibration) -> anyhow::Result<Option<Label>> {
    let words: Vec<&str> = line.split_whitespace().collect();
    if words.len() < 15 {
        bail!("expected 15 columns, found {}: {line}", words.len());
    }
    if words[0].eq_ignore_ascii_case("DontCare") {
        return Ok(None);
    }
    let mut numbers = [0.0; 7];
    for (number, word) in numbers.iter_mut().zip(&words[8..15]) {
        *number = word
            .parse()
            .ok()
            .filter(|v: &f64| v.is_finite())
            .with_context(|| format!("expected a number, found {word}"))?;
    }
    let [height, width, length, x, y, z, rotation_y_rad] = numbers;
    let camera_box = CameraBox {
        location_m: [x, y, z],
        size_hwl_m: [height, width, length],
        rotation_y_rad,
    };
    Ok(Some(Label {
        class: words[0].to_lowercase(),
        box_in_sensor: calibration.box_in_sensor_from_label(&camera_box),
    }))
}

fn calibration(text: &str) -> anyhow::Result<Calibration> {
    let p2 = matrix::<12>(text, "P2")?;
    let r0 = matrix::<9>(text, "R0_rect")?;
    let tr = matrix::<12>(text, "Tr_velo_to_cam")?;
    let rows4 = |m: [f64; 12]| [0, 4, 8].map(|i| [m[i], m[i + 1], m[i + 2], m[i + 3]]);
    let rows3 = |m: [f64; 9]| [0, 3, 6].map(|i| [m[i], m[i + 1], m[i + 2]]);
    Ok(Calibration::new(rows4(p2), rows3(r0), rows4(tr))?)
}

fn matrix<const N: usize>(text: &str, key: &str) -> anyhow::Result<[f64; N]> {
    let line = text
        .lines()
        .find_map(|line| line.strip_prefix(key)?.strip_prefix(':'));
    let words = line
        .with_context(|| format!("{key} is missing"))?
        .split_whitespace();
    let numbers: Vec<f64> = words
        .map(str::parse)
        .collect::<Result<_, _>>()
        .with_context(|| format!("numbers of {key}"))?;
    numbers.try_into().map_err(|found: Vec<f64>| {
        anyhow::anyhow!("{key}: expected {N} numbers, found {}", found.len())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const LINE: &str = "Truck 0.00 0 -2.7107 0 0 100 100 3.0 2.5 8.0 -20.0 1.5 47.0 0.0";

    #[test]
    fn labels_come_into_the_sensor_frame() {
        let label = label(LINE, &Calibration::without_camera())
            .unwrap()
            .unwrap();
        assert_eq!(label.class, "truck");
        assert_eq!(label.box_in_sensor.center_m, [47.0, 20.0, 0.0]);
        assert_eq!(label.box_in_sensor.size_m, [8.0, 2.5, 3.0]);
    }

    #[test]
    fn damage_is_an_error_and_a_region_is_no_box() {
        let calibration = Calibration::without_camera();
        assert!(label("Car 1 2", &calibration).is_err());
        assert!(label(&LINE.replace("47.0", "x"), &calibration).is_err());
        assert_eq!(
            label(&LINE.replace("Truck", "DontCare"), &calibration).unwrap(),
            None
        );
        assert!(super::calibration("P2: 1 2").is_err());
        assert!(super::calibration("nothing").is_err());
        assert!(Labels(None).of("000000").unwrap().is_none());
    }
}
