//! Scans and models at the limits, in every precision: right results, every point accounted for.

mod common;

use common::{calibrated, manifest, scan, written};
use mluc_backbone::{Backbone, Coverage, Precision};
use mluc_model::{Manifest, formula_uniform};

type Fallible<T = ()> = Result<T, Box<dyn std::error::Error>>;

/// Runs a scan with the active cells alone and with all: the same values, finite, nothing uncounted. Gives the voxels.
fn check(manifest: &Manifest, points: &[[f32; 4]], title: &str) -> Fallible<usize> {
    let weights = calibrated(manifest);
    let mut voxels = 0;
    for precision in Precision::ALL {
        let mut backbone = Backbone::with_precision(manifest, &weights, precision)?;
        let channels = backbone.feature_channels();
        let mut assembled = backbone.empty_rows()?;
        let frame = backbone.run(points);
        let (cells, rows) = written(&backbone, frame)?;
        assert!(
            rows.iter().all(|value| value.is_finite()),
            "{title} {precision}"
        );
        for (cell, row) in cells.iter().zip(rows.chunks_exact(channels)) {
            assembled[*cell as usize * channels..][..channels].copy_from_slice(row);
        }
        let everywhere = backbone.run_observed(points, Coverage::Everywhere, &mut |_| ());
        let (_, dense) = written(&backbone, everywhere)?;
        let worst = dense
            .iter()
            .zip(&assembled)
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f32::max);
        assert!(worst < 1e-5, "{title} {precision}: {worst}");
        let counts = frame.points;
        assert_eq!(counts.points as usize, points.len(), "{title}");
        assert_eq!(
            counts.points,
            counts.in_range + counts.out_of_range + counts.non_finite,
            "{title}"
        );
        voxels = counts.voxels as usize;
    }
    Ok(voxels)
}

#[test]
fn all_points_in_one_voxel() -> Fallible {
    let points = vec![[4.03, 0.02, -1.01, 0.4]; 100_000];
    assert_eq!(check(&manifest(), &points, "one voxel")?, 1);
    Ok(())
}

#[test]
fn all_points_in_one_column() -> Fallible {
    let grid = &manifest().network.grid;
    let height = grid.cells()[2];
    let points: Vec<_> = (0..30_000)
        .map(|point| {
            let z = formula_uniform("column", point) as f32 * 3.99 - 2.995;
            [7.05, -1.05, z, 0.1]
        })
        .collect();
    assert_eq!(check(&manifest(), &points, "one column")?, height);
    Ok(())
}

#[test]
fn points_on_the_border_of_the_range() -> Fallible {
    let grid = manifest().network.grid;
    let (low, high) = (grid.range_min_m, grid.range_max_m);
    let mut points = vec![];
    for corner in 0..8 {
        let at = |axis: usize, inside: bool| match (corner >> axis & 1, inside) {
            (0, _) => low[axis],
            (_, true) => high[axis] - 1e-3,
            (_, false) => high[axis],
        };
        points.push([at(0, true), at(1, true), at(2, true), 1.0]);
        points.push([at(0, false), at(1, false), at(2, false), 1.0]);
    }
    // The low corner belongs to the range in both readings, every other corner in the first one alone.
    assert_eq!(check(&manifest(), &points, "border")?, 8);
    Ok(())
}

#[test]
fn a_million_points() -> Fallible {
    let points: Vec<_> = (0..1_000_000)
        .map(|point| {
            let uniform = |i: usize| formula_uniform("million", 4 * point + i) as f32;
            [
                uniform(0) * 16.2 - 0.1,
                uniform(1) * 9.8 - 4.9,
                uniform(2) * 4.2 - 3.1,
                uniform(3),
            ]
        })
        .collect();
    let mut manifest = manifest();
    manifest.network.grid.voxels_max = 60_000;
    assert_eq!(
        check(&manifest, &points, "a million")?,
        60_000,
        "voxels_max is reached"
    );
    Ok(())
}

#[test]
fn no_active_cell() -> Fallible {
    let outside = vec![[-50.0, 0.0, 0.0, 0.5]; 1000];
    assert_eq!(check(&manifest(), &outside, "outside")?, 0);
    assert_eq!(check(&manifest(), &[], "nothing")?, 0);
    Ok(())
}

/// Channels that fill no register, on a map whose edges fill no word and no tile.
#[test]
fn layers_of_odd_sizes() -> Fallible {
    let mut manifest = manifest();
    manifest.network.grid.range_max_m = [15.2, 4.0, 1.0];
    let network = &mut manifest.network;
    let mut cin = 4;
    for (layer, cout) in network
        .sparse
        .iter_mut()
        .zip([6, 10, 18, 22, 34, 50, 14, 26])
    {
        (layer.cin, layer.cout) = (cin, cout);
        cin = cout;
    }
    let mut cin = network.map_channels();
    for (layer, cout) in network.block1.iter_mut().zip([38, 70, 66]) {
        (layer.cin, layer.cout) = (cin, cout);
        cin = cout;
    }
    network.up1.cin = cin;
    for (layer, cout) in network.block2.iter_mut().zip([2, 130, 62, 58]) {
        (layer.cin, layer.cout) = (cin, cout);
        cin = cout;
    }
    network.up2.cin = cin;
    (network.up1.cout, network.up2.cout) = (24, 24);
    let found = check(&manifest, &scan(7, "odd"), "odd sizes")?;
    assert!(found > 50, "{found} voxels");
    Ok(())
}
