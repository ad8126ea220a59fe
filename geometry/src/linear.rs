//! The little linear algebra that a calibration needs, on plain arrays.

/// A rotation (or any 3 x 3 map) and a translation: `target = linear * source + offset`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Affine {
    pub(crate) linear: [[f64; 3]; 3],
    pub(crate) offset: [f64; 3],
}

impl Affine {
    pub(crate) fn apply(&self, point: [f64; 3]) -> [f64; 3] {
        let turned = times_vector(&self.linear, point);
        [0, 1, 2].map(|i| turned[i] + self.offset[i])
    }

    /// The inverse map, or `None` when the determinant is not a finite number away from 0.
    pub(crate) fn inverse(&self) -> Option<Affine> {
        let linear = inverse_3x3(&self.linear)?;
        let moved = times_vector(&linear, self.offset);
        Some(Affine {
            linear,
            offset: moved.map(|v| -v),
        })
    }
}

pub(crate) fn times_vector(m: &[[f64; 3]; 3], v: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|i| m[i][0] * v[0] + m[i][1] * v[1] + m[i][2] * v[2])
}

pub(crate) fn times_matrix(a: &[[f64; 3]; 3], b: &[[f64; 3]; 3]) -> [[f64; 3]; 3] {
    [0, 1, 2].map(|i| [0, 1, 2].map(|j| (0..3).map(|k| a[i][k] * b[k][j]).sum()))
}

/// By the adjugate; rotations are far from singular, so nothing finer is needed.
fn inverse_3x3(m: &[[f64; 3]; 3]) -> Option<[[f64; 3]; 3]> {
    let minor =
        |r0: usize, c0: usize, r1: usize, c1: usize| m[r0][c0] * m[r1][c1] - m[r0][c1] * m[r1][c0];
    let determinant =
        m[0][0] * minor(1, 1, 2, 2) - m[0][1] * minor(1, 0, 2, 2) + m[0][2] * minor(1, 0, 2, 1);
    if !determinant.is_finite() || determinant.abs() < 1e-9 {
        return None;
    }
    let adjugate = [
        [minor(1, 1, 2, 2), -minor(0, 1, 2, 2), minor(0, 1, 1, 2)],
        [-minor(1, 0, 2, 2), minor(0, 0, 2, 2), -minor(0, 0, 1, 2)],
        [minor(1, 0, 2, 1), -minor(0, 0, 2, 1), minor(0, 0, 1, 1)],
    ];
    Some(adjugate.map(|row| row.map(|v| v / determinant)))
}
