//! How far the outputs of a network move when it is computed in a shorter precision.

use mluc_backbone::{Backbone, Precision};
use mluc_dataset::Dataset;
use mluc_head::Head;
use mluc_model::{Manifest, WeightSet};

use super::read_points;
use crate::error::TrainError;

/// The error of each output of the network in one precision.
#[derive(Clone, Debug, PartialEq)]
pub struct OutputErrors {
    /// Of the backbone.
    pub precision: Precision,
    /// `features` and the heads by name: root mean square of the difference from f32, over the root mean square in f32.
    pub outputs: Vec<(String, f64)>,
}

/// Runs `frames` in f32 and in every shorter precision; all cells that have a feature row count. `step` is called after
/// each frame.
pub fn compare(
    manifest: &Manifest,
    weights: &WeightSet,
    dataset: &Dataset,
    frames: &[String],
    mut step: impl FnMut(),
) -> Result<Vec<OutputErrors>, TrainError> {
    let head = Head::new(manifest, weights)?;
    let mut names = vec!["features".to_string()];
    let heads = manifest.network.heads().into_iter();
    names.extend(heads.map(|head| head.0.to_string()));
    let mut exact = Backbone::new(manifest, weights)?;
    let short = [Precision::Bf16, Precision::Int8].into_iter();
    let mut short = short
        .map(|precision| Backbone::with_precision(manifest, weights, precision))
        .collect::<Result<Vec<_>, _>>()?;
    // Sums of the squares of each output: of its difference, and exact.
    let mut squares = vec![vec![[0.0; 2]; names.len()]; short.len()];
    for name in frames {
        let points = read_points(dataset, name)?;
        let expected = outputs(&mut exact, &head, &points)?;
        for (backbone, squares) in short.iter_mut().zip(&mut squares) {
            let found = outputs(backbone, &head, &points)?;
            for ((squares, expected), found) in squares.iter_mut().zip(&expected).zip(&found) {
                for (expected, found) in expected.iter().zip(found) {
                    squares[0] += f64::from(expected - found).powi(2);
                    squares[1] += f64::from(*expected).powi(2);
                }
            }
        }
        step();
    }
    let errors = short.iter().zip(squares).map(|(backbone, squares)| {
        let errors = squares
            .iter()
            .map(|[difference, exact]| (difference / exact).sqrt());
        OutputErrors {
            precision: backbone.precision(),
            outputs: names.iter().cloned().zip(errors).collect(),
        }
    });
    Ok(errors.collect())
}

/// The feature rows, then each head on them. Every precision has the same rows.
fn outputs(
    backbone: &mut Backbone,
    head: &Head,
    points: &[[f32; 4]],
) -> Result<Vec<Vec<f32>>, TrainError> {
    backbone.run(points);
    let (_, rows) = backbone.last_rows()?;
    let heads = head.outputs(&rows);
    Ok(std::iter::once(rows).chain(heads).collect())
}
