//! `poses.txt`: where the sensor was, a line a scan.

use std::fs;
use std::path::Path;

use anyhow::{Context, bail};
use mluc_ipc_types::EgoPose;

/// Reads `poses.txt` in the folder of scans or above it: `x y z yaw` of the sensor in a frame that stands still (m, rad),
/// a line a scan; empty lines and those that begin with `#` are left out. None where there is no such file. Errors:
/// another number of lines than scans, a line that is not four finite numbers.
pub(super) fn read(folder: &Path, scans: usize) -> anyhow::Result<Option<Vec<EgoPose>>> {
    let Some(path) = super::beside(folder, "poses.txt") else {
        return Ok(None);
    };
    let text = fs::read_to_string(&path).with_context(|| format!("poses {}", path.display()))?;
    let mut poses = Vec::new();
    for (number, line) in text.lines().enumerate() {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let pose = pose(line).with_context(|| {
            format!(
                "poses {}, line {}: expected four finite numbers `x y z yaw` (m, rad), found `{line}`",
                path.display(),
                number + 1
            )
        })?;
        poses.push(pose);
    }
    if poses.len() != scans {
        bail!(
            "poses {}: expected one a scan, {scans}, found {}",
            path.display(),
            poses.len()
        );
    }
    Ok(Some(poses))
}

fn pose(line: &str) -> Option<EgoPose> {
    let numbers: Vec<f64> = line
        .split_whitespace()
        .map(|word| word.parse().ok().filter(|v: &f64| v.is_finite()))
        .collect::<Option<_>>()?;
    let [x, y, z, yaw_rad] = numbers[..] else {
        return None;
    };
    Some(EgoPose {
        position_m: [x, y, z],
        yaw_rad,
        is_known: 1,
        reserved: 0,
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
        assert!(
            read(&tempfile::tempdir().unwrap().path().join("a"), 2)
                .unwrap()
                .is_none()
        );
    }

    #[test]
    fn what_is_wrong_is_named() {
        let text = |content: &str| {
            let folder = folder_with(content);
            format!("{:#}", read(folder.path(), 2).unwrap_err())
        };
        assert!(text("1 2 3 4\n").contains("expected one a scan, 2, found 1"));
        assert!(text("1 2 3 4\n1 2 x 4\n").contains("line 2"));
        assert!(text("1 2 3 4\n1 2 3\n").contains("found `1 2 3`"));
        assert!(text("NaN 2 3 4\n1 2 3 4\n").contains("line 1"));
    }
}
