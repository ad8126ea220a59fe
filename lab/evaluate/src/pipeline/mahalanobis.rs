//! Distance of an embedding to the classes as they scatter (Lee et al., NeurIPS 2018): class means and one shared covariance.
//!
//! Both come from the boxes on known labels in the other half of the frames (even against odd), so that no box is compared with
//! itself, and no training data is needed.

use mluc_ipc_types::CLASSES_MAX;
use nalgebra::{SMatrix, SVector};
use std::collections::BTreeMap;

/// Added to the variances: embeddings without scatter have no inverse.
const RIDGE: f64 = 0.01;

type Vector = SVector<f64, CLASSES_MAX>;
type Matrix = SMatrix<f64, CLASSES_MAX, CLASSES_MAX>;

/// A box: half of the frames that it is in (0 or 1), class of its label (none on unknown labels and on background), embedding.
pub(super) type Embedded<'a> = (usize, Option<&'a str>, Vector);

/// The least squared distance of each box to a class; NaN where no box of the other half lies on a known label.
pub(super) fn mahalanobis(boxes: &[Embedded]) -> Vec<f64> {
    let fits = [1, 0].map(|half| {
        let others = boxes.iter().filter(|b| b.0 == half);
        ClassFit::of(others.filter_map(|b| Some((b.1?, b.2))))
    });
    let boxes = boxes.iter();
    boxes.map(|b| fits[b.0].distance(&b.2)).collect()
}

struct ClassFit {
    means: Vec<Vector>,
    /// Lower triangle of the covariance's Cholesky factor.
    factor: Matrix,
}

impl ClassFit {
    fn of<'a>(known: impl Iterator<Item = (&'a str, Vector)>) -> ClassFit {
        let mut classes: BTreeMap<&str, Vec<Vector>> = BTreeMap::new();
        known.for_each(|(name, f)| classes.entry(name).or_default().push(f));
        let count = classes.values().map(Vec::len).sum::<usize>() as f64;
        let mut covariance = Matrix::from_diagonal_element(RIDGE);
        let mut means = Vec::new();
        for list in classes.values() {
            let mean = list.iter().sum::<Vector>() / list.len() as f64;
            for f in list {
                covariance += (f - mean) * (f - mean).transpose() / count;
            }
            means.push(mean);
        }
        // The ridge makes any covariance positive definite, unless an embedding is not finite: then no distance means anything.
        let factor = covariance.cholesky().map(|c| c.l());
        ClassFit {
            means,
            factor: factor.unwrap_or_else(Matrix::identity),
        }
    }

    fn distance(&self, f: &Vector) -> f64 {
        let to = |mean: &Vector| {
            let scaled = self.factor.solve_lower_triangular(&(f - mean));
            scaled.map_or(f64::INFINITY, |v| v.norm_squared())
        };
        self.means.iter().map(to).fold(f64::NAN, f64::min)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scatter_sets_the_scale_of_a_distance() {
        let at = |x: f64, y: f64| {
            let mut f: Vector = Default::default();
            (f[0], f[1]) = (x, y);
            f
        };
        // Class a scatters by 2 along x, class b likewise, both not at all along y.
        let a = [-2.0, 2.0].map(|x| ("a", at(x, 0.0)));
        let b = [8.0, 12.0].map(|x| ("b", at(x, 3.0)));
        let fit = ClassFit::of(a.into_iter().chain(b));
        let [along, across] = [fit.distance(&at(1.0, 0.0)), fit.distance(&at(0.0, 1.0))];
        assert!((along - 1.0 / 4.01).abs() < 1e-9 && (across - 1.0 / 0.01).abs() < 1e-6);
        assert!(fit.distance(&at(10.0, 3.0)) < 1e-12);
        let none = ClassFit::of(std::iter::empty());
        assert!(none.distance(&at(0.0, 0.0)).is_nan());
    }
}
