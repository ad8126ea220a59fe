//! The whole backbone on random scans, in every precision: the active cells alone give the result of the dense computation, with
//! any number of threads, and from frame to frame in the same memory; bf16 and int8 are close to f32.

mod common;

use common::{backbone, calibrated, check_coverage, manifest, relative_error, scan};
use mluc_backbone::{Backbone, BackboneError, Coverage, Level, Precision};
use mluc_model::formula_weights;
use mluc_train::quantize::measure_ranges;
use std::collections::{BTreeMap, BTreeSet};

type Fallible<T = ()> = Result<T, Box<dyn std::error::Error>>;

#[test]
fn active_cells_give_the_dense_result_and_absent_cells_the_empty_scene() -> Fallible {
    let manifest = manifest();
    for precision in Precision::ALL {
        let mut backbone = backbone(&manifest, precision)?;
        let empty = backbone.empty_rows()?;
        let cells = empty.len() / backbone.feature_channels();
        let mut absent = 0;
        for (blobs, seed) in [(1, "a"), (12, "b"), (0, "c"), (3, "d"), (2, "e")] {
            let (_, active) = check_coverage(&mut backbone, &empty, &scan(blobs, seed))?;
            absent += cells - active;
        }
        assert!(absent > 1000, "the scans leave cells uncomputed: {absent}");
    }
    Ok(())
}

/// Each level's values by its name, and the cells of block2 that were computed.
type Levels = (BTreeMap<String, Vec<f32>>, BTreeSet<usize>);

fn levels(backbone: &mut Backbone, blobs: usize) -> Fallible<Levels> {
    let mut levels = BTreeMap::new();
    let observe = &mut |level: Level| {
        levels.insert(level.name.to_owned(), level.values.to_vec());
    };
    backbone.run_observed(&scan(blobs, "halo"), Coverage::Active, observe);
    let columns = backbone.map_shape()[1];
    let (cells, _) = backbone.last_rows()?;
    let cells = cells.iter().map(|cell| *cell as usize);
    let halved = cells.map(|cell| cell / columns / 2 * (columns / 2) + cell % columns / 2);
    Ok((levels, halved.collect()))
}

#[test]
fn after_the_halo_a_layer_computes_the_cells_of_the_layer_before() -> Fallible {
    let mut manifest = manifest();
    let [last, next] = [0, 1].map(|number| manifest.network.block2[number].name.clone());
    for precision in Precision::ALL {
        manifest.network.halo_layers = None;
        let weights = calibrated(&manifest);
        let build = |manifest: &_| Backbone::with_precision(manifest, &weights, precision);
        let (dense, every_cell) = levels(&mut build(&manifest)?, 2)?;
        manifest.network.halo_layers = Some(manifest.network.block1.len() + 1);
        let mut limited = build(&manifest)?;
        let [rows, columns] = limited.map_shape().map(|edge| edge / 2);
        let (found, cells) = levels(&mut limited, 2)?;
        assert!(cells.len() < every_cell.len() && cells.is_subset(&every_cell));
        assert_eq!(dense[&last], found[&last]);
        let row = |values: &[f32], cell: usize| {
            let channels = values.len() / (rows * columns);
            values[cell * channels..][..channels].to_vec()
        };
        let (empty, _) = levels(&mut limited, 0)?;
        let mut inner = 0;
        for cell in 0..rows * columns {
            let (y, x) = (cell / columns, cell % columns);
            let around = [y.max(1) - 1, y, (y + 1).min(rows - 1)]
                .map(|y| [x.max(1) - 1, x, (x + 1).min(columns - 1)].map(|x| y * columns + x));
            if !cells.contains(&cell) {
                assert_eq!(row(&found[&next], cell), row(&empty[&next], cell));
            } else if around.iter().flatten().all(|cell| cells.contains(cell)) {
                assert_eq!(row(&found[&next], cell), row(&dense[&next], cell));
                inner += 1;
            }
        }
        assert!(inner > 10, "{inner}");
    }
    Ok(())
}

#[test]
fn the_bits_do_not_depend_on_threads_or_on_the_frame_before() -> Fallible {
    let mut manifest = manifest();
    let halo_layers = [None, Some(manifest.network.block1.len() + 1)];
    let cases = Precision::ALL.map(|precision| halo_layers.map(|layers| (precision, layers)));
    for (precision, halo_layers) in cases.into_iter().flatten() {
        manifest.network.halo_layers = halo_layers;
        let fresh = backbone(&manifest, precision)?;
        let run = |threads: usize, before: &[&str]| -> Fallible<Vec<u32>> {
            let mut backbone = fresh.clone();
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
            let (mut bits, rows) = pool.build()?.install(|| {
                for seed in before {
                    backbone.run(&scan(8, seed));
                }
                backbone.run(&scan(6, "measured"));
                backbone.last_rows()
            })?;
            bits.extend(rows.iter().map(|value| value.to_bits()));
            Ok(bits)
        };
        let bits = run(1, &[])?;
        assert!(bits.len() > 1000);
        for (threads, before) in [(2, &[][..]), (2, &["x", "y"]), (5, &[])] {
            assert!(bits == run(threads, before)?, "{precision}");
        }
    }
    Ok(())
}

#[test]
fn a_buffer_of_another_length_and_a_model_that_does_not_fit_are_refused() -> Fallible {
    let manifest = manifest();
    let mut weights = formula_weights(&manifest.network);
    let mut backbone = Backbone::new(&manifest, &weights)?;
    let rows = backbone.run(&scan(1, "w")).rows;
    let mut values = vec![0.0; rows * backbone.feature_channels() - 1];
    let error = backbone.write_rows(&mut vec![0; rows], &mut values);
    let what = "values";
    assert!(matches!(error, Err(BackboneError::Room(found, ..)) if found == what));
    weights.remove("backbone2d.up2.weight");
    let error = Backbone::new(&manifest, &weights).expect_err("a tensor is missing");
    let error = error.to_string();
    assert!(error.contains("`backbone2d.up2.weight`"), "{error}");
    Ok(())
}

#[test]
fn short_ones_are_close_to_f32() -> Fallible {
    let manifest = manifest();
    let mut exact = backbone(&manifest, Precision::F32)?;
    // The largest allowed ratio of the difference's root mean square to the root mean square in f32.
    for (precision, error_max) in [(Precision::Bf16, 0.02), (Precision::Int8, 0.05)] {
        let mut short = backbone(&manifest, precision)?;
        assert_eq!(short.precision(), precision);
        for (blobs, seed) in [(1, "a"), (12, "b"), (4, "c")] {
            let points = scan(blobs, seed);
            let frames = [exact.run(&points), short.run(&points)];
            assert_eq!(frames[0], frames[1], "the same points and rows");
            let (cells, expected) = exact.last_rows()?;
            let (cells_short, found) = short.last_rows()?;
            assert_eq!(cells, cells_short);
            let error = relative_error(&expected, &found);
            // An error of zero would mean that f32 was computed.
            let fits = (1e-6..error_max).contains(&error);
            assert!(fits, "{precision}, scan {seed}: {error} of the rms");
        }
    }
    Ok(())
}

#[test]
fn levels_are_shown_as_f32_in_any_precision() -> Fallible {
    let manifest = manifest();
    let mut seen = vec![];
    for precision in Precision::ALL {
        let mut levels = vec![];
        let observe = &mut |level: Level| {
            let largest = level.values.iter().copied().fold(0.0, f32::max);
            levels.push((level.name.to_string(), level.values.len(), largest));
        };
        backbone(&manifest, precision)?.run_observed(&scan(2, "levels"), Coverage::Active, observe);
        seen.push(levels);
    }
    assert!(seen[0].len() > 8);
    for short in &seen[1..] {
        assert_eq!(seen[0].len(), short.len());
        for (exact, short) in seen[0].iter().zip(short) {
            assert_eq!((&exact.0, exact.1), (&short.0, short.1));
            assert!((exact.2 - short.2).abs() <= 0.15 * exact.2, "{exact:?} and {short:?}");
        }
    }
    Ok(())
}

#[test]
fn int8_without_a_calibration_names_the_command() {
    let manifest = manifest();
    let weights = formula_weights(&manifest.network);
    let error = Backbone::with_precision(&manifest, &weights, Precision::Int8);
    let error = error.expect_err("no calibration").to_string();
    assert!(error.contains("mluc-lab quantize --model"), "{error}");
}

#[test]
fn nothing_to_calibrate_on_is_said() {
    let manifest = manifest();
    let weights = formula_weights(&manifest.network);
    // First no frame; then an empty scene, whose map is 0.
    for scans in [vec![], vec![Ok(vec![])]] {
        let frames = scans.len();
        let fault = measure_ranges::<Vec<[f32; 4]>>(&manifest, &weights, scans);
        let text = fault.expect_err("nothing was seen").to_string();
        assert!(text.contains(&format!("found {frames} frames")), "{text}");
    }
}
