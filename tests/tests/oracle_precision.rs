//! The paper's network in bf16 and int8 on the oracle's scans: how much the heads' outputs differ from f32.

use mluc_backbone::{Backbone, Precision};
use mluc_head::Head;
use mluc_model::formula_weights;
use mluc_tests::{PaperFrame, feature_map, paper_frames, paper_network, rms};
use mluc_train::quantize::measure_ranges;

type Fallible<T = ()> = Result<T, Box<dyn std::error::Error>>;

/// Largest ratio of the difference's root mean square to the root mean square in f32.
const ERROR_MAX: [(Precision, f64); 2] = [(Precision::Bf16, 0.02), (Precision::Int8, 0.05)];

#[test]
fn head_outputs_of_second_stay_close_to_f32() -> Fallible {
    for frame in paper_frames()? {
        stays_close(&frame).map_err(|error| format!("{}: {error}", frame.name))?;
    }
    Ok(())
}

fn stays_close(frame: &PaperFrame) -> Fallible {
    let manifest = paper_network();
    // The ranges of int8 come from the mirrored scan (left to right), which is similar but not the same.
    let points = frame.points.iter();
    let turned: Vec<_> = points.map(|&[x, y, z, i]| [x, -y, z, i]).collect();
    let weights = measure_ranges(&manifest, &formula_weights(&manifest.network), [Ok(turned)])?;
    let head = Head::new(&manifest, &weights)?;
    // Runs the heads on every cell of the map.
    let outputs = |precision| -> Fallible<Vec<Vec<f32>>> {
        let mut backbone = Backbone::with_precision(&manifest, &weights, precision)?;
        let empty = backbone.empty_rows()?;
        backbone.run(&frame.points);
        Ok(head.outputs(&feature_map(&backbone, empty)?))
    };
    let expected = outputs(Precision::F32)?;
    for (precision, error_max) in ERROR_MAX {
        let found = outputs(precision)?;
        let names = manifest.network.heads().into_iter().map(|(name, _)| name);
        for (name, (expected, found)) in names.zip(expected.iter().zip(&found)) {
            assert_eq!(expected.len(), found.len(), "every cell has every output");
            let differences = expected.iter().zip(found).map(|(a, b)| a - b);
            let error = rms(differences) / rms(expected.iter().copied());
            let title = format!("{} {precision} {name}", frame.name);
            println!("{title}: {:.2} %", 100.0 * error);
            // An error of zero would mean that f32 was computed.
            assert!((1e-4..=error_max).contains(&error), "{title}: {error} of the rms");
        }
    }
    Ok(())
}
