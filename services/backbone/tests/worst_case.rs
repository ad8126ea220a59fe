//! Scans and models at the limits, in every precision: right results, every point accounted for.

mod common;

use common::{backbone, check_coverage, manifest, scan};
use mluc_backbone::Precision;
use mluc_model::{Manifest, formula_uniform};

type Fallible<T = ()> = Result<T, Box<dyn std::error::Error>>;

/// Checks a scan in every precision; gives its voxels.
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
fn all_points_in_one_voxel() -> Fallible {
    let points = vec![[4.03, 0.02, -1.01, 0.4]; 100_000];
    assert_eq!(check(&manifest(), &points)?, 1);
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
    assert_eq!(check(&manifest(), &points)?, height);
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
    assert_eq!(check(&manifest(), &points)?, 8);
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
    // voxels_max is reached.
    assert_eq!(check(&manifest, &points)?, 60_000);
    Ok(())
}

#[test]
fn no_active_cell() -> Fallible {
    let outside = vec![[-50.0, 0.0, 0.0, 0.5]; 1000];
    assert_eq!(check(&manifest(), &outside)?, 0);
    assert_eq!(check(&manifest(), &[])?, 0);
    Ok(())
}

/// Channels that fill no register, on a map whose edges fill no word and no tile.
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
    for (layer, cout) in blocks.zip([38, 70, 66, 2, 130, 62, 58]) {
        (layer.cin, layer.cout) = (cin, cout);
        cin = cout;
    }
    (network.up1.cin, network.up2.cin) = (66, 58);
    (network.up1.cout, network.up2.cout) = (24, 24);
    let found = check(&manifest, &scan(7, "odd"))?;
    assert!(found > 50, "{found} voxels");
    Ok(())
}
