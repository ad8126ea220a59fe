//! The whole backbone on random scans: the active cells alone give what the dense computation gives, with any number of
//! threads, from frame to frame in the same memory.

mod common;

use common::{manifest, scan, written};
use mluc_backbone::{Backbone, BackboneError, Coverage};
use mluc_model::formula_weights;

type Fallible = Result<(), Box<dyn std::error::Error>>;

#[test]
fn active_cells_give_the_dense_result_and_absent_cells_the_empty_scene() -> Fallible {
    let manifest = manifest();
    let mut backbone = Backbone::new(&manifest, &formula_weights(&manifest.network))?;
    let channels = backbone.feature_channels();
    let empty = backbone.empty_rows()?;
    let mut absent = 0;
    for (blobs, seed) in [(1, "a"), (12, "b"), (0, "c"), (3, "d"), (2, "e")] {
        let points = scan(blobs, seed);
        let frame = backbone.run(&points);
        let (cells, rows) = written(&backbone, frame)?;
        let mut assembled = empty.clone();
        for (cell, row) in cells.iter().zip(rows.chunks_exact(channels)) {
            assembled[*cell as usize * channels..][..channels].copy_from_slice(row);
        }
        let frame = backbone.run_observed(&points, Coverage::Everywhere, &mut |_| ());
        let (_, dense) = written(&backbone, frame)?;
        assert_eq!(dense.len(), assembled.len());
        let worst = dense
            .iter()
            .zip(&assembled)
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f32::max);
        assert!(worst < 1e-5, "scan {seed}: {worst}");
        absent += empty.len() / channels - cells.len();
    }
    assert!(absent > 1000, "the scans leave cells uncomputed: {absent}");
    Ok(())
}

#[test]
fn the_bits_do_not_depend_on_threads_or_on_the_frame_before() -> Fallible {
    let manifest = manifest();
    let fresh = Backbone::new(&manifest, &formula_weights(&manifest.network))?;
    let run = |threads: usize, before: &[&str]| -> Result<Vec<u32>, Box<dyn std::error::Error>> {
        let mut backbone = fresh.clone();
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()?;
        let bits = pool.install(|| {
            for seed in before {
                backbone.run(&scan(8, seed));
            }
            let frame = backbone.run(&scan(6, "measured"));
            let (mut bits, rows) = written(&backbone, frame)?;
            bits.extend(rows.iter().map(|value| value.to_bits()));
            Ok::<_, BackboneError>(bits)
        })?;
        Ok(bits)
    };
    let bits = run(1, &[])?;
    assert!(bits.len() > 1000);
    assert_eq!(bits, run(2, &[])?);
    assert_eq!(bits, run(2, &["x", "y"])?);
    Ok(())
}

#[test]
fn warming_up_changes_no_bit() -> Fallible {
    let manifest = manifest();
    let mut cold = Backbone::new(&manifest, &formula_weights(&manifest.network))?;
    let mut warm = cold.clone();
    warm.warm_up(&manifest)?;
    assert_eq!(warm.rows(), 0, "its frames are forgotten");
    let points = scan(6, "measured");
    let (a, b) = (cold.run(&points), warm.run(&points));
    assert!(a.rows > 10);
    assert_eq!(a, b);
    assert!(written(&cold, a)? == written(&warm, b)?);
    Ok(())
}

#[test]
fn an_empty_scan_has_no_row_and_points_are_accounted_for() -> Fallible {
    let manifest = manifest();
    let mut backbone = Backbone::new(&manifest, &formula_weights(&manifest.network))?;
    assert_eq!(backbone.run(&[]).rows, 0);
    let mut points = scan(5, "z");
    points.push([f32::NAN; 4]);
    let counts = backbone.run(&points).points;
    assert_eq!(counts.points as usize, points.len());
    assert_eq!(
        counts.points,
        counts.non_finite + counts.out_of_range + counts.in_range
    );
    assert_eq!(counts.non_finite, 1);
    assert!(counts.out_of_range > 0 && counts.voxels > 0 && counts.voxels <= counts.in_range);
    Ok(())
}

#[test]
fn a_buffer_of_another_length_and_a_model_that_does_not_fit_are_refused() -> Fallible {
    let manifest = manifest();
    let mut weights = formula_weights(&manifest.network);
    let mut backbone = Backbone::new(&manifest, &weights)?;
    let rows = backbone.run(&scan(1, "w")).rows;
    let channels = backbone.feature_channels();
    let error = backbone.write_rows(&mut vec![0; rows], &mut vec![0.0; rows * channels - 1]);
    assert!(
        matches!(error, Err(BackboneError::Room { what: "values", .. })),
        "{error:?}"
    );
    weights.remove("backbone2d.up2.weight");
    let error = Backbone::new(&manifest, &weights)
        .expect_err("a tensor is missing")
        .to_string();
    assert!(error.contains("`backbone2d.up2.weight`"), "{error}");
    Ok(())
}
