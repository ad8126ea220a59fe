//! Calibration files: named matrices, one a line, row by row.

use super::{DatasetError, read_text};
use mluc_geometry::Calibration;
use std::path::Path;

/// Reads `P2`, `R0_rect` and `Tr_velo_to_cam` of a KITTI calibration file; other lines are passed over.
///
/// A missing matrix, a wrong count of numbers or a map that cannot be inverted is an error. `P2` may be all 0.
pub fn read_calibration(path: &Path) -> Result<Calibration, DatasetError> {
    parse(path, &read_text(path)?)
}

fn parse(path: &Path, text: &str) -> Result<Calibration, DatasetError> {
    let p2 = matrix::<4>(path, text, "P2")?;
    let r0_rect = matrix::<3>(path, text, "R0_rect")?;
    let velo_to_cam = matrix::<4>(path, text, "Tr_velo_to_cam")?;
    Calibration::new(p2, r0_rect, velo_to_cam).map_err(|cause| DatasetError::Calibration {
        path: path.to_owned(),
        cause,
    })
}

/// The matrix of three rows and `COLUMNS` columns on the line `name: ...`.
fn matrix<const COLUMNS: usize>(
    path: &Path,
    text: &str,
    name: &'static str,
) -> Result<[[f64; COLUMNS]; 3], DatasetError> {
    let (line, values) = text
        .lines()
        .enumerate()
        .find_map(|(i, line)| {
            let (key, values) = line.split_once(':')?;
            (key.trim() == name).then_some((i + 1, values))
        })
        .ok_or_else(|| DatasetError::MissingMatrix {
            path: path.to_owned(),
            name,
        })?;
    let columns: Vec<&str> = values.split_whitespace().collect();
    if columns.len() != 3 * COLUMNS {
        let expected = if COLUMNS == 3 { "9" } else { "12" };
        return Err(DatasetError::Columns {
            path: path.to_owned(),
            line,
            expected,
            found: columns.len(),
            missing: "",
        });
    }
    let mut matrix = [[0.0; COLUMNS]; 3];
    for (value, text) in matrix.iter_mut().flatten().zip(&columns) {
        *value = text
            .parse()
            .ok()
            .filter(|v: &f64| v.is_finite())
            .ok_or_else(|| DatasetError::Field {
                path: path.to_owned(),
                line,
                field: name,
                expected: "finite numbers",
                found: text.chars().take(40).collect(),
            })?;
    }
    Ok(matrix)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIMULATED: &str = "P0: 0 0 0 0 0 0 0 0 0 0 0 0\nP2: 0 0 0 0 0 0 0 0 0 0 0 0\nR0_rect: 1 0 0 0 1 0 0 0 1\n\
        Tr_velo_to_cam: 0 -1 0 0 0 0 -1 0 1 0 0 0\n";

    fn fault(text: &str) -> String {
        parse(Path::new("c.txt"), text)
            .expect_err("a fault")
            .to_string()
    }

    #[test]
    fn reads_a_frame_without_a_camera() {
        let calibration = parse(Path::new("c.txt"), SIMULATED).expect("valid");
        assert_eq!(calibration, Calibration::without_camera());
    }

    #[test]
    fn faults_are_named() {
        assert_eq!(
            fault("P2: 0"),
            "c.txt, line 1: expected 12 columns, found 1"
        );
        assert_eq!(
            fault(&SIMULATED.replace("R0_rect", "R1")),
            "c.txt: expected a line 'R0_rect: ...', found none"
        );
        let word = fault(&SIMULATED.replace("1 0 0 0\n", "1 0 0 x\n"));
        assert_eq!(
            word,
            "c.txt, line 4, field Tr_velo_to_cam: expected finite numbers, found 'x'"
        );
        assert!(
            fault(&SIMULATED.replace("0 -1 0 0 0 0 -1 0 1 0 0 0", "0 0 0 0 0 0 0 0 0 0 0 0"))
                .contains("invertible")
        );
    }
}
