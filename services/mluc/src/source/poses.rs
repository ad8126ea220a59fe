//! `poses.txt`: where the sensor was, a line a scan.

use std::fs;
use std::path::Path;

use anyhow::{Context, ensure};
use mluc_ipc_types::EgoPose;

/// Reads `poses.txt` in the folder of scans or above it: `x y z yaw` of the sensor in a frame that stands still (m, rad),
/// a line a scan; empty lines and those that begin with `#` are left out. None where there is no such file. Errors:
/// another number of lines than scans, a line that is not four finite numbers.
pub(super) fn read(folder: &Path, scans: usize) -> anyhow::Result<Option<Vec<EgoPose>>> {
    let Some(path) = super::beside(folder, "poses.txt") else {
        return Ok(None);
    };
    let name = path.display();
    let text = fs::read_to_string(&path).with_context(|| format!("poses {name}"))?;
    let mut poses = Vec::new();
    let lines = (1..).zip(text.lines().map(str::trim));
    for (number, line) in lines.filter(|(_, line)| !line.is_empty() && !line.starts_with('#')) {
        let expected = "expected four finite numbers `x y z yaw` (m, rad)";
        let fault = || format!("poses {name}, line {number}: {expected}, found `{line}`");
        poses.push(pose(line).with_context(fault)?);
    }
    let found = poses.len();
    let expected = format!("expected one a scan, {scans}");
    ensure!(found == scans, "poses {name}: {expected}, found {found}");
    Ok(Some(poses))
}

fn pose(line: &str) -> Option<EgoPose> {
    let words = line.split_whitespace();
    let numbers = words.map(|word| word.parse().ok().filter(|v: &f64| v.is_finite()));
    let [x, y, z, yaw_rad] = numbers.collect::<Option<Vec<f64>>>()?[..] else {
        return None;
    };
    Some(EgoPose {
        position_m: [x, y, z],
        yaw_rad,
        is_known: 1,
        ..EgoPose::default()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder_with(text: &str) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("poses.txt"), text).unwrap();
        folder
    }

    #[test]
    fn a_line_a_scan_is_read_also_from_the_folder_above() {
        let folder = folder_with("# x y z yaw\n1 2 0 0.5\n\n2.5 2 0 -0.5\n");
        let inner = folder.path().join("velodyne");
        let poses = read(&inner, 2).unwrap().unwrap();
        assert_eq!(poses[1].position_m, [2.5, 2.0, 0.0]);
        assert_eq!((poses[0].yaw_rad, poses[0].is_known), (0.5, 1));
        let none = tempfile::tempdir().unwrap();
        assert!(read(&none.path().join("a"), 2).unwrap().is_none());
    }

    #[test]
    fn what_is_wrong_is_named() {
        for (content, words) in [
            ("1 2 3 4\n", "expected one a scan, 2, found 1"),
            ("1 2 3 4\n1 2 x 4\n", "line 2"),
            ("1 2 3 4\n1 2 3\n", "found `1 2 3`"),
            ("NaN 2 3 4\n1 2 3 4\n", "line 1"),
        ] {
            let error = read(folder_with(content).path(), 2).unwrap_err();
            assert!(format!("{error:#}").contains(words), "{error:#}");
        }
    }
}
