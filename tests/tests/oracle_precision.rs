//! The paper's network in bf16 and int8 on the oracle's scan and weights: how far the heads' outputs move from f32.

use std::path::{Path, PathBuf};

use mluc_backbone::{Backbone, Precision};
use mluc_head::Head;
use mluc_model::{Grid, Manifest, Network, WeightSet, formula_weights};
use mluc_tests::oracle;
use mluc_train::quantize::measure_ranges;

type Fallible<T = ()> = Result<T, Box<dyn std::error::Error>>;

/// Root mean square of the difference, of the root mean square in f32.
const ERROR_MAX: [(Precision, f64); 2] = [(Precision::Bf16, 0.02), (Precision::Int8, 0.05)];

#[test]
fn head_outputs_of_second_stay_close_to_f32() -> Fallible {
    let Some(folder) = oracle() else {
        return Ok(());
    };
    let grid = Grid {
        voxels_max: mluc_model::VOXELS_MAX,
        ..Grid::kitti_second()
    };
    let manifest = Manifest::untrained("oracle", Network::second(grid, 3));
    let scans = scans(&folder.join("second_forward"))?;
    assert!(!scans.is_empty(), "the oracle holds a scan");
    for scan in scans {
        stays_close(&manifest, &scan).map_err(|error| format!("{}: {error}", scan.display()))?;
    }
    Ok(())
}

/// Every scan of the oracle's folder.
fn scans(folder: &Path) -> Fallible<Vec<PathBuf>> {
    let entries = std::fs::read_dir(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let paths = entries.map(|entry| Ok(entry?.path()));
    let mut scans: Vec<PathBuf> = paths.collect::<Fallible<_>>()?;
    scans.retain(|path| path.extension().is_some_and(|extension| extension == "bin"));
    Ok(scans)
}

fn stays_close(manifest: &Manifest, scan: &Path) -> Fallible {
    let points = read_points(scan)?;
    let weights = calibrated(manifest, &points)?;
    let head = Head::new(manifest, &weights)?;
    let names = manifest.network.heads();
    let expected = heads(manifest, &weights, &head, Precision::F32, &points)?;
    for (precision, error_max) in ERROR_MAX {
        let found = heads(manifest, &weights, &head, precision, &points)?;
        for (name, (expected, found)) in names.iter().zip(expected.iter().zip(&found)) {
            assert_eq!(expected.len(), found.len(), "every cell has every output");
            let difference = expected.iter().zip(found).map(|(a, b)| a - b);
            let error = rms(difference) / rms(expected.iter().copied());
            println!("{precision} {}: {:.2} %", name.0, 100.0 * error);
            assert!(
                (1e-4..=error_max).contains(&error),
                "{precision} {}: {error} of the rms; none at all would mean that f32 was computed",
                name.0
            );
        }
    }
    Ok(())
}

/// Ranges of int8 from the scan turned left to right: one like it, and not the same.
fn calibrated(manifest: &Manifest, points: &[[f32; 4]]) -> Fallible<WeightSet> {
    let turned: Vec<_> = points.iter().map(|&[x, y, z, i]| [x, -y, z, i]).collect();
    let weights = formula_weights(&manifest.network);
    Ok(measure_ranges(manifest, &weights, [Ok(turned)])?)
}

/// The heads' outputs on every cell of the map.
fn heads(
    manifest: &Manifest,
    weights: &WeightSet,
    head: &Head,
    precision: Precision,
    points: &[[f32; 4]],
) -> Fallible<Vec<Vec<f32>>> {
    let mut backbone = Backbone::with_precision(manifest, weights, precision)?;
    let channels = backbone.feature_channels();
    let mut values = backbone.empty_rows()?;
    let count = backbone.run(points).rows;
    let (mut cells, mut rows) = (vec![0; count], vec![0.0; count * channels]);
    backbone.write_rows(&mut cells, &mut rows)?;
    for (cell, row) in cells.iter().zip(rows.chunks_exact(channels)) {
        values[*cell as usize * channels..][..channels].copy_from_slice(row);
    }
    Ok(head.outputs(&values))
}

fn rms(values: impl Iterator<Item = f32>) -> f64 {
    let (count, sum) = values.fold((0, 0.0), |(count, sum), value| {
        (count + 1, sum + f64::from(value).powi(2))
    });
    (sum / f64::from(count)).sqrt()
}

fn read_points(path: &Path) -> Fallible<Vec<[f32; 4]>> {
    let bytes = std::fs::read(path).map_err(|error| format!("{}: {error}", path.display()))?;
    Ok(bytes
        .chunks_exact(16)
        .map(bytemuck::pod_read_unaligned)
        .collect())
}
