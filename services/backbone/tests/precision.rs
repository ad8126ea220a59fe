//! bf16 and int8 against f32 on weights by formula: close, as sparse, the same bits with any number of threads.

mod common;

use common::{calibrated, manifest, scan, written};
use mluc_backbone::{Backbone, BackboneError, Coverage, Precision};
use mluc_model::{Manifest, formula_weights};
use mluc_train::quantize::measure_ranges;

type Fallible<T = ()> = Result<T, Box<dyn std::error::Error>>;

/// The short ones, and the most that the root mean square of the difference may be of the root mean square in f32.
const SHORT: [(Precision, f64); 2] = [(Precision::Bf16, 0.02), (Precision::Int8, 0.05)];

fn backbone(manifest: &Manifest, precision: Precision) -> Result<Backbone, BackboneError> {
    let weights = match precision {
        Precision::Int8 => calibrated(manifest),
        _ => formula_weights(&manifest.network),
    };
    Backbone::with_precision(manifest, &weights, precision)
}

fn rms(values: impl Iterator<Item = f64> + Clone) -> f64 {
    (values.clone().map(|value| value * value).sum::<f64>() / values.count() as f64).sqrt()
}

#[test]
fn short_ones_are_close_to_f32() -> Fallible {
    let manifest = manifest();
    let mut exact = backbone(&manifest, Precision::F32)?;
    for (precision, error_max) in SHORT {
        let mut short = backbone(&manifest, precision)?;
        assert_eq!(short.precision(), precision);
        for (blobs, seed) in [(1, "a"), (12, "b"), (4, "c")] {
            let points = scan(blobs, seed);
            let frames = [exact.run(&points), short.run(&points)];
            assert_eq!(frames[0], frames[1], "the same points and rows");
            let (cells, expected) = written(&exact, frames[0])?;
            let (cells_short, found) = written(&short, frames[1])?;
            assert_eq!(cells, cells_short);
            let difference = expected.iter().zip(&found);
            let error = rms(difference.map(|(a, b)| f64::from(a - b)))
                / rms(expected.iter().map(|value| f64::from(*value)));
            println!("{precision}, scan {seed}: {error:.4}");
            assert!(
                (1e-6..error_max).contains(&error),
                "{precision}, scan {seed}: {error} of the rms; none at all would mean that f32 was computed"
            );
        }
    }
    Ok(())
}

#[test]
fn active_cells_in_short_are_those_of_all() -> Fallible {
    let manifest = manifest();
    for (precision, _) in SHORT {
        let mut backbone = backbone(&manifest, precision)?;
        let channels = backbone.feature_channels();
        let mut assembled = backbone.empty_rows()?;
        let points = scan(3, "sparse");
        let frame = backbone.run(&points);
        let (cells, rows) = written(&backbone, frame)?;
        for (cell, row) in cells.iter().zip(rows.chunks_exact(channels)) {
            assembled[*cell as usize * channels..][..channels].copy_from_slice(row);
        }
        let frame = backbone.run_observed(&points, Coverage::Everywhere, &mut |_| ());
        let (all, dense) = written(&backbone, frame)?;
        assert!(cells.len() < all.len(), "some cells stay uncomputed");
        assert!(dense == assembled, "{precision}");
    }
    Ok(())
}

#[test]
fn short_ones_have_the_same_bits_with_any_number_of_threads() -> Fallible {
    let manifest = manifest();
    for (precision, _) in SHORT {
        let fresh = backbone(&manifest, precision)?;
        let bits = |threads: usize| -> Fallible<Vec<u32>> {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()?;
            let mut backbone = fresh.clone();
            let rows = pool.install(|| {
                let frame = backbone.run(&scan(9, "threads"));
                written(&backbone, frame)
            });
            Ok(rows?.1.into_iter().map(f32::to_bits).collect())
        };
        let one = bits(1)?;
        assert!(one.len() > 1000);
        assert!(one == bits(2)? && one == bits(5)?, "{precision}");
    }
    Ok(())
}

#[test]
fn levels_are_shown_as_f32_in_any_precision() -> Fallible {
    let manifest = manifest();
    let mut seen = vec![];
    for precision in Precision::ALL {
        let mut levels = vec![];
        backbone(&manifest, precision)?.run_observed(
            &scan(2, "levels"),
            Coverage::Active,
            &mut |level| {
                let largest = level.values.iter().copied().fold(0.0, f32::max);
                levels.push((level.name.to_string(), level.values.len(), largest));
            },
        );
        seen.push(levels);
    }
    assert!(seen[0].len() > 8);
    for short in &seen[1..] {
        assert_eq!(seen[0].len(), short.len());
        for (exact, short) in seen[0].iter().zip(short) {
            assert_eq!((&exact.0, exact.1), (&short.0, short.1));
            assert!(
                (exact.2 - short.2).abs() <= 0.15 * exact.2,
                "{exact:?} and {short:?}"
            );
        }
    }
    Ok(())
}

/// In the bird's-eye layers; int8 takes any number there.
#[test]
fn an_odd_number_of_channels_is_refused_in_bf16_and_computed_in_the_others() -> Fallible {
    let mut manifest = manifest();
    let (last, network) = (manifest.network.block1.len() - 1, &mut manifest.network);
    network.block1[last].cout = 47;
    network.block2[0].cin = 47;
    network.up1.cin = 47;
    let error = backbone(&manifest, Precision::Bf16)
        .expect_err("47 channels")
        .to_string();
    assert!(error.contains("found 47"), "{error}");
    for precision in [Precision::F32, Precision::Int8] {
        let mut backbone = backbone(&manifest, precision)?;
        assert!(backbone.run(&scan(1, "odd")).rows > 0);
    }
    Ok(())
}

#[test]
fn int8_without_a_calibration_names_the_command() {
    let manifest = manifest();
    let weights = formula_weights(&manifest.network);
    let error = Backbone::with_precision(&manifest, &weights, Precision::Int8)
        .expect_err("no calibration")
        .to_string();
    assert!(error.contains("mluc-lab quantize --model"), "{error}");
}

#[test]
fn nothing_to_calibrate_on_is_said() {
    let manifest = manifest();
    let weights = formula_weights(&manifest.network);
    // No frame; an empty scene, whose map is 0.
    for scans in [vec![], vec![Ok(vec![])]] {
        let frames = scans.len();
        let fault = measure_ranges::<Vec<[f32; 4]>>(&manifest, &weights, scans);
        let text = fault.expect_err("nothing was seen").to_string();
        assert!(text.contains(&format!("found {frames} frames")), "{text}");
    }
}
