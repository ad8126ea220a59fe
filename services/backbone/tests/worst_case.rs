//! Scans and models at the limits, in every precision: the results are right, and every point is counted.

mod common;

use common::{backbone, check_coverage, manifest, scan};
use mluc_backbone::Precision;
use mluc_model::{Manifest, VoxelInput, formula_uniform};

type Fallible<T = ()> = Result<T, Box<dyn std::error::Error>>;

/// Checks a scan in every precision; returns its number of voxels.
fn check(manifest: &Manifest, points: &[[f32; 4]]) -> Fallible<usize> {
    let mut voxels = 0;
    for precision in Precision::ALL {
        let mut backbone = backbone(manifest, precision)?;
        let empty = backbone.empty_rows()?;
        let (frame, _) = check_coverage(&mut backbone, &empty, points)?;
        voxels = frame.points.voxels as usize;
    }
    Ok(voxels)
}

#[test]
fn every_point_in_one_voxel_one_column_or_beyond_the_range() -> Fallible {
    let grid = manifest().network.grid;
    let (low, high, height) = (grid.range_min_m, grid.range_max_m, grid.cells()[2]);
    let voxel = vec![[4.03, 0.02, -1.01, 0.4]; 100_000];
    let z = |point: usize| formula_uniform("column", point) as f32 * 3.99 - 2.995;
    let column = (0..30_000).map(|point| [7.05, -1.05, z(point), 0.1]);
    let corner = |corner: usize| {
        // The low corner is in the range with both values of `inside`, every other corner only with the first value.
        [1e-3, 0.0].map(|inside| {
            let at = |axis: usize| [low[axis], high[axis] - inside][corner >> axis & 1];
            [at(0), at(1), at(2), 1.0]
        })
    };
    let border = (0..8).flat_map(corner);
    let outside = vec![[-50.0, 0.0, 0.0, 0.5]; 1000];
    for (what, points, voxels) in [
        ("one voxel", voxel, 1),
        ("one column", column.collect(), height),
        ("the border", border.collect(), 8),
        ("outside", outside, 0),
        ("nothing", vec![], 0),
    ] {
        assert_eq!(check(&manifest(), &points)?, voxels, "{what}");
    }
    let mut local = manifest();
    (local.network.input, local.sensor_height_m) = (VoxelInput::Local, 0.5);
    let missing = [[0.0; 4]; 1000];
    assert_eq!(check(&local, &missing)?, 0, "missing returns");
    Ok(())
}

#[test]
fn a_million_points() -> Fallible {
    let point = |point: usize| {
        let uniform = |i: usize| formula_uniform("million", 4 * point + i) as f32;
        let (x, y) = (uniform(0) * 16.2 - 0.1, uniform(1) * 9.8 - 4.9);
        [x, y, uniform(2) * 4.2 - 3.1, uniform(3)]
    };
    let points: Vec<_> = (0..1_000_000).map(point).collect();
    let mut manifest = manifest();
    manifest.network.grid.voxels_max = 60_000;
    // This scan reaches voxels_max.
    assert_eq!(check(&manifest, &points)?, 60_000);
    Ok(())
}

/// The channels do not fill a register; the edges of the map fill neither a word nor a tile.
#[test]
fn layers_of_odd_sizes() -> Fallible {
    let mut manifest = manifest();
    manifest.network.grid.range_max_m = [15.2, 4.0, 1.0];
    let network = &mut manifest.network;
    let mut cin = 4;
    let sparse = network.sparse.iter_mut();
    for (layer, cout) in sparse.zip([6, 10, 18, 22, 34, 50, 14, 26]) {
        (layer.cin, layer.cout) = (cin, cout);
        cin = cout;
    }
    cin = network.map_channels();
    let blocks = network.block1.iter_mut().chain(&mut network.block2);
    for (layer, cout) in blocks.zip([38, 70, 47, 2, 130, 62, 58]) {
        (layer.cin, layer.cout) = (cin, cout);
        cin = cout;
    }
    (network.up1.cin, network.up2.cin) = (47, 58);
    (network.up1.cout, network.up2.cout) = (24, 24);
    let found = check(&manifest, &scan(7, "odd"))?;
    assert!(found > 50, "{found} voxels");
    Ok(())
}
