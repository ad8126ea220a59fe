//! Convex polygons: clipping by half planes (Sutherland and Hodgman, 1974) and area.

/// A convex polygon of at most `MAX` corners, in order.
#[derive(Clone, Copy, Debug)]
pub struct Polygon<const MAX: usize> {
    corners: [[f64; 2]; MAX],
    count: usize,
}

impl<const MAX: usize> Polygon<MAX> {
    /// From corners in order; corners beyond `MAX` are left out. Rounding could add such a corner only to a polygon that is not convex.
    pub fn new(corners: impl IntoIterator<Item = [f64; 2]>) -> Polygon<MAX> {
        let (mut polygon, corners) = (Polygon::EMPTY, corners.into_iter());
        corners.for_each(|corner| polygon.push(corner));
        polygon
    }

    const EMPTY: Polygon<MAX> = Polygon { corners: [[0.0; 2]; MAX], count: 0 };

    fn push(&mut self, corner: [f64; 2]) {
        if self.count < MAX {
            self.corners[self.count] = corner;
            self.count += 1;
        }
    }

    /// The corners in order.
    pub fn corners(&self) -> &[[f64; 2]] {
        &self.corners[..self.count]
    }

    /// The part where `normal . corner <= limit`.
    pub fn cut(&self, normal: [f64; 2], limit: f64) -> Polygon<MAX> {
        let beyond = |c: [f64; 2]| c[0] * normal[0] + c[1] * normal[1] - limit;
        let mut kept = Polygon::EMPTY;
        for i in 0..self.count {
            let (from, to) = (self.corners[i], self.corners[(i + 1) % self.count]);
            let (a, b) = (beyond(from), beyond(to));
            if a <= 0.0 {
                kept.push(from);
            }
            if (a < 0.0 && b > 0.0) || (a > 0.0 && b < 0.0) {
                let t = a / (a - b);
                kept.push([0, 1].map(|axis| from[axis] + t * (to[axis] - from[axis])));
            }
        }
        kept
    }

    /// The area by the shoelace formula; never negative.
    pub fn area(&self) -> f64 {
        let corners = self.corners();
        let next = corners.iter().cycle().skip(1);
        let add = |sum: f64, (a, b): (&[f64; 2], &[f64; 2])| sum + (a[0] * b[1] - a[1] * b[0]);
        corners.iter().zip(next).fold(0.0, add).abs() / 2.0
    }
}
