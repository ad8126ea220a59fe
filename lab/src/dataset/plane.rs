//! Ground planes: `a b c d` with `a x + b y + c z + d = 0` in the camera frame, after a header of three lines.

use super::{DatasetError, read_text};
use std::path::Path;

/// Reads the plane: the last line that is not empty must hold four finite numbers.
pub fn read_plane(path: &Path) -> Result<[f64; 4], DatasetError> {
    let text = read_text(path)?;
    let last = text
        .lines()
        .enumerate()
        .filter(|(_, line)| !line.trim().is_empty())
        .last();
    let (line, content) = last.map_or((1, ""), |(i, line)| (i + 1, line));
    let columns: Vec<&str> = content.split_whitespace().collect();
    let &[a, b, c, d] = columns.as_slice() else {
        let found = columns.len();
        return Err(DatasetError::Columns {
            path: path.to_owned(),
            line,
            expected: "4",
            found,
            missing: "",
        });
    };
    let mut plane = [0.0; 4];
    for (value, text) in plane.iter_mut().zip([a, b, c, d]) {
        *value = text
            .parse()
            .ok()
            .filter(|v: &f64| v.is_finite())
            .ok_or_else(|| DatasetError::Field {
                path: path.to_owned(),
                line,
                field: "plane",
                expected: "a finite number",
                found: text.chars().take(40).collect(),
            })?;
    }
    Ok(plane)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_the_last_line() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("p.txt");
        std::fs::write(&path, "# Plane\nWidth 4\nHeight 1\n0.0 -1.0 0.0 1.73\n").expect("written");
        assert_eq!(read_plane(&path).expect("a plane"), [0.0, -1.0, 0.0, 1.73]);
        std::fs::write(&path, "# Plane\n0.0 -1.0\n").expect("written");
        assert!(
            read_plane(&path)
                .expect_err("short")
                .to_string()
                .contains("line 2: expected 4 columns, found 2")
        );
    }
}
