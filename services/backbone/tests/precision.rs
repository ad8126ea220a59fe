//! bf16 against f32 on weights by formula: close, as sparse, the same bits with any number of threads.

mod common;

use common::{manifest, scan, written};
use mluc_backbone::{Backbone, BackboneError, Coverage, Precision};
use mluc_model::{Manifest, formula_weights};

type Fallible<T = ()> = Result<T, Box<dyn std::error::Error>>;

/// Root mean square of the difference, of the root mean square in f32.
const ERROR_MAX: f64 = 0.02;

fn backbone(manifest: &Manifest, precision: Precision) -> Result<Backbone, BackboneError> {
    Backbone::with_precision(manifest, &formula_weights(&manifest.network), precision)
}

fn rms(values: impl Iterator<Item = f64> + Clone) -> f64 {
    (values.clone().map(|value| value * value).sum::<f64>() / values.count() as f64).sqrt()
}

#[test]
fn bf16_is_close_to_f32() -> Fallible {
    let manifest = manifest();
    let (mut exact, mut short) = (
        backbone(&manifest, Precision::F32)?,
        backbone(&manifest, Precision::Bf16)?,
    );
    assert_eq!(
        (exact.precision(), short.precision()),
        (Precision::F32, Precision::Bf16)
    );
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
        assert!(
            (1e-6..ERROR_MAX).contains(&error),
            "scan {seed}: {error} of the rms; none at all would mean that f32 was computed"
        );
    }
    Ok(())
}

#[test]
fn bf16_of_active_cells_is_that_of_all() -> Fallible {
    let manifest = manifest();
    let mut backbone = backbone(&manifest, Precision::Bf16)?;
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
    assert_eq!(dense, assembled);
    Ok(())
}

#[test]
fn bf16_has_the_same_bits_with_any_number_of_threads() -> Fallible {
    let manifest = manifest();
    let fresh = backbone(&manifest, Precision::Bf16)?;
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
    assert_eq!(one, bits(2)?);
    assert_eq!(one, bits(5)?);
    Ok(())
}

#[test]
fn levels_are_shown_as_f32_in_either_precision() -> Fallible {
    let manifest = manifest();
    let mut seen = vec![];
    for precision in [Precision::F32, Precision::Bf16] {
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
    assert_eq!(seen[0].len(), seen[1].len());
    for (exact, short) in seen[0].iter().zip(&seen[1]) {
        assert_eq!((&exact.0, exact.1), (&short.0, short.1));
        assert!(
            (exact.2 - short.2).abs() <= 0.1 * exact.2,
            "{exact:?} and {short:?}"
        );
    }
    Ok(())
}

#[test]
fn an_odd_number_of_channels_is_refused_in_bf16_and_computed_in_f32() -> Fallible {
    let mut manifest = manifest();
    let (last, network) = (manifest.network.block1.len() - 1, &mut manifest.network);
    network.block1[last].cout = 47;
    network.block2[0].cin = 47;
    network.up1.cin = 47;
    let error = backbone(&manifest, Precision::Bf16)
        .expect_err("47 channels")
        .to_string();
    assert!(error.contains("found 47"), "{error}");
    assert!(
        backbone(&manifest, Precision::F32)?
            .run(&scan(1, "odd"))
            .rows
            > 0
    );
    Ok(())
}
