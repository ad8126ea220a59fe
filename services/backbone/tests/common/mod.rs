//! A small model, scans of blobs, and the written rows.
#![allow(dead_code)] // Each test file uses a part of it.

use mluc_backbone::{Backbone, BackboneError, Coverage, Frame, Precision};
use mluc_model::{Grid, Manifest, Network, WeightSet, formula_uniform, formula_weights};
use mluc_train::quantize::measure_ranges;

pub(crate) type Run<T> = Result<T, BackboneError>;

/// A map of 24 x 40 cells.
pub(crate) fn manifest() -> Manifest {
    let grid = Grid::kitti_compact().within([0.0, 16.0], [-4.8, 4.8]);
    Manifest::untrained("small", Network::compact(grid, 3))
}

/// Blobs of points, some at the border and beyond.
pub(crate) fn scan(blobs: usize, seed: &str) -> Vec<[f32; 4]> {
    let uniform = |index: usize, low: f64, high: f64| {
        (low + (high - low) * formula_uniform(seed, index)) as f32
    };
    (0..blobs * 60)
        .map(|point| {
            let blob = point / 60 * 1000 + 500_000;
            [
                uniform(blob, -0.5, 16.5) + uniform(4 * point, -0.6, 0.6),
                uniform(blob + 1, -5.0, 5.0) + uniform(4 * point + 1, -0.6, 0.6),
                uniform(blob + 2, -2.5, 0.5) + uniform(4 * point + 2, -0.6, 0.6),
                uniform(4 * point + 3, 0.0, 1.0),
            ]
        })
        .collect()
}

/// Weights by formula with a calibration on two scans.
pub(crate) fn calibrated(manifest: &Manifest) -> WeightSet {
    let scans = ["calibration 1", "calibration 2"].map(|seed| Ok(scan(10, seed)));
    measure_ranges(manifest, &formula_weights(&manifest.network), scans)
        .expect("every level has values")
}

/// A backbone with calibrated weights.
pub(crate) fn backbone(manifest: &Manifest, precision: Precision) -> Run<Backbone> {
    Backbone::with_precision(manifest, &calibrated(manifest), precision)
}

/// The ratio of the difference's root mean square to the expected values' root mean square.
pub(crate) fn relative_error(expected: &[f32], found: &[f32]) -> f64 {
    let square = |value: f32| f64::from(value).powi(2);
    let differences = expected.iter().zip(found).map(|(a, b)| square(a - b));
    let squares = expected.iter().map(|value| square(*value));
    (differences.sum::<f64>() / squares.sum::<f64>()).sqrt()
}

/// Runs a scan with the active cells alone, put into `empty`'s rows, and with all cells. The values must be equal and finite (in f32
/// tiles round differently from direct sums), and every point must be counted. Returns the frame and its cells.
pub(crate) fn check_coverage(
    backbone: &mut Backbone,
    empty: &[f32],
    points: &[[f32; 4]],
) -> Run<(Frame, usize)> {
    let frame = backbone.run(points);
    let (cells, rows) = backbone.last_rows()?;
    assert!(rows.iter().all(|value| value.is_finite()));
    let assembled = mluc_tests::feature_map(backbone, empty.to_vec())?;
    backbone.run_observed(points, Coverage::Everywhere, &mut |_| ());
    let (_, dense) = backbone.last_rows()?;
    assert_eq!(dense.len(), assembled.len());
    let worst = dense.iter().zip(&assembled).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    let by_tiles = backbone.precision() == Precision::F32;
    assert!(worst <= if by_tiles { 1e-5 } else { 0.0 }, "{worst}");
    let counts = frame.points;
    assert_eq!(counts.points as usize, points.len());
    let all = counts.in_range + counts.out_of_range + counts.non_finite;
    assert_eq!(counts.points, all);
    Ok((frame, cells.len()))
}
