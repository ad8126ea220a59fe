//! Models and scans, made up.

use std::fs;
use std::path::{Path, PathBuf};

use mluc_model::{Grid, Manifest, Network, formula_weights, model_bytes};

/// Writes a model with weights by formula, small and quick: it sees shapes and no sense. Its gate calls half of its
/// boxes candidates, so that all stages have work.
pub fn untrained_model(folder: &Path) -> PathBuf {
    let network = Network::compact(Grid::kitti_compact(), 3);
    let weights = formula_weights(&network);
    let mut manifest = Manifest::untrained("untrained", network);
    manifest.thresholds.objectness_min = 0.6;
    manifest.thresholds.boxes_max = 40;
    manifest.thresholds.eds_normalised_max = 1.5;
    let path = folder.join("untrained.safetensors");
    fs::write(
        &path,
        model_bytes(&manifest, &weights).expect("a sound model"),
    )
    .expect("a writable folder");
    path
}

/// Ground around the sensor and a car-sized box `distance_m` ahead, about 20,000 points.
pub fn car_scan(distance_m: f32) -> Vec<[f32; 4]> {
    let mut points = Vec::new();
    for ring in 0..60 {
        let range = 4.0 + ring as f32 * 0.7;
        points.extend((0..300).map(|step| {
            let angle = (step as f32 - 150.0) * 0.005;
            [range * angle.cos(), range * angle.sin(), -1.73, 0.3]
        }));
    }
    for column in 0..40 {
        points.extend((0..15).map(|row| {
            let (y, z) = (-0.9 + column as f32 * 0.045, -1.6 + row as f32 * 0.1);
            [distance_m, y, z, 0.6]
        }));
    }
    points
}

/// Writes KITTI's `.bin`.
pub fn write_scan(path: &Path, points: &[[f32; 4]]) {
    let bytes: Vec<u8> = points
        .iter()
        .flatten()
        .flat_map(|v| v.to_le_bytes())
        .collect();
    fs::write(path, bytes).expect("a writable folder");
}

/// A folder of `count` sound scans, 000000.bin and so on.
pub fn clean_folder(folder: &Path, count: usize) -> PathBuf {
    let input = folder.join("scans");
    fs::create_dir_all(&input).expect("a writable folder");
    for number in 0..count {
        write_scan(
            &input.join(format!("{number:06}.bin")),
            &car_scan(8.0 + number as f32),
        );
    }
    input
}
