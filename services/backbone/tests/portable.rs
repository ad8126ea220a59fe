//! A processor without vector registers gives the same answers, but slower. This file has one test: it turns the registers off for the whole program.

mod common;

use common::{calibrated, manifest, relative_error, scan};
use mluc_backbone::{Backbone, Precision};
use mluc_kernels::Level;

#[test]
fn without_vector_registers_the_answers_are_the_same() -> Result<(), Box<dyn std::error::Error>> {
    let manifest = manifest();
    let weights = calibrated(&manifest);
    let points = scan(9, "portable");
    let mut levels = Level::all();
    let portable = levels.pop().ok_or("no level")?;
    assert_eq!(portable.name(), "portable");
    let run = |precision| {
        let mut backbone = Backbone::with_precision(&manifest, &weights, precision)?;
        backbone.run(&points);
        backbone.last_rows()
    };
    let best = Precision::ALL.map(run);
    portable.restrict();
    assert_eq!(Level::best(), portable);
    // Products of bf16 round once or twice; a value next to a step of int8 may round to the other side.
    let error_max = [1e-6, 2e-3, 2e-2];
    for ((precision, best), error_max) in Precision::ALL.into_iter().zip(best).zip(error_max) {
        let ((cells, rows), (cells_portable, rows_portable)) = (best?, run(precision)?);
        assert_eq!(cells, cells_portable);
        assert!(rows.len() > 1000);
        let error = relative_error(&rows, &rows_portable);
        assert!(error < error_max, "{precision}: {error} of the rms");
    }
    Ok(())
}
