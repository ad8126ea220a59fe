//! Distance of an embedding to the classes as they scatter (Lee et al., NeurIPS 2018): class means and one shared covariance.
//!
//! Both come from the boxes on known labels in the other half of the frames (even against odd), so that no box is compared with
//! itself, and no training data is needed.

use super::separation::JudgedBox;
use crate::evaluate::Kind;
use mluc_ipc_types::CLASSES_MAX;

/// Added to the variances: embeddings without scatter have no inverse.
const RIDGE: f64 = 0.01;

type Vector = [f64; CLASSES_MAX];
type Matrix = [Vector; CLASSES_MAX];

/// The least squared distance of each box to a class.
pub(super) fn mahalanobis(boxes: &[JudgedBox]) -> Vec<f64> {
    let fits = [0, 1].map(|half| {
        let known = boxes.iter().filter_map(|b| {
            let rule = b.rule.filter(|rule| rule.kind == Kind::Known)?;
            (b.frame % 2 != half).then(|| (rule.name.as_str(), embedding(b)))
        });
        Fit::of(known)
    });
    boxes
        .iter()
        .map(|b| fits[b.frame % 2].distance(&embedding(b)))
        .collect()
}

fn embedding(labelled: &JudgedBox) -> Vector {
    labelled.detection.embedding.map(f64::from)
}

struct Fit {
    means: Vec<Vector>,
    /// Lower triangle of the covariance's Cholesky factor.
    factor: Matrix,
}

impl Fit {
    fn of<'a>(known: impl Iterator<Item = (&'a str, Vector)>) -> Fit {
        let mut classes: Vec<(&str, Vec<Vector>)> = vec![];
        for (name, f) in known {
            match classes.iter_mut().find(|(other, _)| *other == name) {
                Some((_, list)) => list.push(f),
                None => classes.push((name, vec![f])),
            }
        }
        let mean = |list: &[Vector]| -> Vector {
            std::array::from_fn(|i| list.iter().map(|f| f[i]).sum::<f64>() / list.len() as f64)
        };
        let means: Vec<Vector> = classes.iter().map(|(_, list)| mean(list)).collect();
        let count: usize = classes.iter().map(|(_, list)| list.len()).sum();
        let mut covariance: Matrix = Default::default();
        for ((_, list), mean) in classes.iter().zip(&means) {
            for f in list {
                for i in 0..CLASSES_MAX {
                    for j in 0..CLASSES_MAX {
                        covariance[i][j] += (f[i] - mean[i]) * (f[j] - mean[j]) / count as f64;
                    }
                }
            }
        }
        (0..CLASSES_MAX).for_each(|i| covariance[i][i] += RIDGE);
        Fit {
            means,
            factor: cholesky(&covariance),
        }
    }

    fn distance(&self, f: &Vector) -> f64 {
        let to = |mean: &Vector| {
            let mut y: Vector = Default::default();
            for i in 0..CLASSES_MAX {
                let before: f64 = (0..i).map(|j| self.factor[i][j] * y[j]).sum();
                y[i] = (f[i] - mean[i] - before) / self.factor[i][i];
            }
            y.iter().map(|v| v * v).sum::<f64>()
        };
        self.means.iter().map(to).fold(f64::INFINITY, f64::min)
    }
}

/// Of a positive definite matrix: the ridge makes any covariance one.
fn cholesky(a: &Matrix) -> Matrix {
    let mut l: Matrix = Default::default();
    for i in 0..CLASSES_MAX {
        for j in 0..=i {
            let sum: f64 = (0..j).map(|k| l[i][k] * l[j][k]).sum();
            l[i][j] = match i == j {
                true => (a[i][i] - sum).max(RIDGE * RIDGE).sqrt(),
                false => (a[i][j] - sum) / l[j][j],
            };
        }
    }
    l
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
        let known = [
            ("a", at(-2.0, 0.0)),
            ("a", at(2.0, 0.0)),
            ("b", at(8.0, 3.0)),
            ("b", at(12.0, 3.0)),
        ];
        let fit = Fit::of(known.into_iter());
        let [along, across] = [fit.distance(&at(1.0, 0.0)), fit.distance(&at(0.0, 1.0))];
        assert!((along - 1.0 / 4.01).abs() < 1e-9 && (across - 1.0 / 0.01).abs() < 1e-6);
        assert!(fit.distance(&at(10.0, 3.0)) < 1e-12);
        assert_eq!(
            Fit::of(std::iter::empty()).distance(&at(0.0, 0.0)),
            f64::INFINITY
        );
    }
}
