//! The part of a scan that KITTI's left colour camera sees, as its labels cover no more.

use std::path::Path;

use anyhow::{Context, Result, ensure};

/// Edges of a picture, pixels: those of most of KITTI's.
const PICTURE: [f64; 2] = [1242.0, 375.0];

/// Picture from sensor, up to a factor: P2 * R0_rect * Tr_velo_to_cam.
pub(crate) struct View([[f64; 4]; 3]);

impl View {
    /// By the calibration of a scan: `.../velodyne/NAME.bin` has `.../calib/NAME.txt`.
    pub(crate) fn beside(scan: &Path) -> Result<View> {
        let folder = scan
            .parent()
            .and_then(Path::parent)
            .context("a scan in a folder")?;
        let name = scan.file_stem().context("a scan with a name")?;
        let path = folder.join("calib").join(name).with_extension("txt");
        let text = std::fs::read_to_string(&path).with_context(|| path.display().to_string())?;
        let matrix = |key: &str, columns: usize| {
            read_matrix(&text, key, columns).with_context(|| format!("{}: {key}", path.display()))
        };
        let sensor = matrix("Tr_velo_to_cam", 4)?;
        let turned = product(&matrix("R0_rect", 3)?, &sensor);
        let mut view = product(&matrix("P2", 4)?, &turned);
        // The fourth row of the inner matrix is 0, 0, 0, 1.
        for (row, to) in matrix("P2", 4)?.iter().zip(&mut view) {
            to[3] += row[3];
        }
        Ok(View(view))
    }

    /// Whether a point lies in front of the camera and inside its picture.
    pub(crate) fn sees(&self, [x, y, z, _]: [f32; 4]) -> bool {
        let at = [x, y, z].map(f64::from);
        let [u, v, depth] = self
            .0
            .map(|row| row[0] * at[0] + row[1] * at[1] + row[2] * at[2] + row[3]);
        depth > 0.0
            && (0.0..PICTURE[0] * depth).contains(&u)
            && (0.0..PICTURE[1] * depth).contains(&v)
    }
}

/// Three rows of at most four columns, 0 beyond.
fn read_matrix(text: &str, key: &str, columns: usize) -> Result<[[f64; 4]; 3]> {
    let line = text
        .lines()
        .find_map(|line| line.strip_prefix(key)?.strip_prefix(':'))
        .context("no such line")?;
    let values = line
        .split_whitespace()
        .map(str::parse::<f64>)
        .collect::<Result<Vec<_>, _>>()?;
    ensure!(
        values.len() == 3 * columns,
        "{} values expected, found {}",
        3 * columns,
        values.len()
    );
    let mut matrix = [[0.0; 4]; 3];
    for (row, values) in matrix.iter_mut().zip(values.chunks_exact(columns)) {
        row[..columns].copy_from_slice(values);
    }
    Ok(matrix)
}

/// The first three columns of `a`, times `b`.
fn product(a: &[[f64; 4]; 3], b: &[[f64; 4]; 3]) -> [[f64; 4]; 3] {
    a.map(|row| [0, 1, 2, 3].map(|j| (0..3).map(|k| row[k] * b[k][j]).sum()))
}
