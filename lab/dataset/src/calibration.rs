//! Calibration files: named matrices, one per line, in row order.

use super::{DatasetError, Result, error::Line, read_text};
use mluc_geometry::Calibration;
use std::path::Path;

/// Reads `P2`, `R0_rect` and `Tr_velo_to_cam` of a KITTI calibration file; other lines are skipped.
///
/// A missing matrix, a wrong count of numbers or a transform that cannot be inverted is an error. `P2` may be all 0.
pub fn read_calibration(path: &Path) -> Result<Calibration> {
    parse(path, &read_text(path)?)
}

fn parse(path: &Path, text: &str) -> Result<Calibration> {
    let p2 = matrix::<4>(path, text, "P2")?;
    let r0_rect = matrix::<3>(path, text, "R0_rect")?;
    let velo_to_cam = matrix::<4>(path, text, "Tr_velo_to_cam")?;
    Calibration::new(p2, r0_rect, velo_to_cam)
        .map_err(|cause| DatasetError::Calibration(path.to_owned(), cause))
}

/// The matrix of three rows and N columns on the line `name: ...`.
fn matrix<const N: usize>(path: &Path, text: &str, name: &str) -> Result<[[f64; N]; 3]> {
    let mut lines = text.lines().enumerate();
    let found = lines.find_map(|(index, line)| {
        let (key, values) = line.split_once(':')?;
        (key.trim() == name).then_some((Line { path, index }, values))
    });
    let Some((line, values)) = found else {
        let expected = format!("a line '{name}: ...'");
        return Err(DatasetError::at(path, expected, "none"));
    };
    let columns: Vec<&str> = values.split_whitespace().collect();
    if columns.len() != 3 * N {
        return Err(line.fault(format!("{} columns", 3 * N), columns.len()));
    }
    let mut matrix = [[0.0; N]; 3];
    for (value, text) in matrix.as_flattened_mut().iter_mut().zip(&columns) {
        let number = text.parse().ok().filter(|v: &f64| v.is_finite());
        *value = number.ok_or_else(|| line.in_field(name, "finite numbers", text))?;
    }
    Ok(matrix)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIMULATED: &str = "P0: 0 0 0 0 0 0 0 0 0 0 0 0\nP2: 0 0 0 0 0 0 0 0 0 0 0 0\nR0_rect: 1 0 0 0 1 0 0 0 1\n\
        Tr_velo_to_cam: 0 -1 0 0 0 0 -1 0 1 0 0 0\n";

    #[test]
    fn faults_are_named() {
        for line in include_str!("calibration_faults.txt").lines() {
            let [whole, broken, expected] = line.split('|').collect::<Vec<_>>()[..] else {
                panic!("{line}");
            };
            let text = SIMULATED.replace(whole, broken);
            let fault = parse(Path::new("c.txt"), &text).expect_err("a fault");
            assert_eq!(fault.to_string(), expected);
        }
    }
}
