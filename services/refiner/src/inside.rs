//! Whether points lie in a box: its heading's sine and cosine are taken once.

use mluc_geometry::Box3;

/// A box prepared for many questions.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Inside {
    center_m: [f64; 3],
    half_m: [f64; 3],
    sin: f64,
    cos: f64,
}

impl Inside {
    /// Of the box with a margin on every side, m.
    pub(crate) fn of(shape: &Box3, margin_m: f64) -> Inside {
        let (sin, cos) = shape.yaw_rad.sin_cos();
        Inside {
            center_m: shape.center_m,
            half_m: shape.size_m.map(|s| s / 2.0 + margin_m),
            sin,
            cos,
        }
    }

    /// Inside or on the surface.
    pub(crate) fn contains(&self, at_m: [f32; 3]) -> bool {
        let [dx, dy, dz] = [0, 1, 2].map(|i| f64::from(at_m[i]) - self.center_m[i]);
        (dx * self.cos + dy * self.sin).abs() <= self.half_m[0]
            && (dy * self.cos - dx * self.sin).abs() <= self.half_m[1]
            && dz.abs() <= self.half_m[2]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agrees_with_the_box() {
        let shape = Box3::new([10.0, -3.0, 0.5, 4.0, 2.0, 1.5, 0.7]);
        let inside = Inside::of(&shape, 0.0);
        let places = (0..4000).map(|i| {
            let f = |k: f32| (i as f32 * k).sin() * 3.0;
            [10.0 + f(0.7), -3.0 + f(1.3), 0.5 + f(2.1) * 0.5]
        });
        let (within, outside): (Vec<_>, _) = places.partition(|&at| inside.contains(at));
        assert!(within.len() > 20 && outside.len() > 20);
        let contains = |at: &[f32; 3]| shape.contains(at.map(f64::from));
        assert!(within.iter().all(contains) && !outside.iter().any(contains));
        assert!(!inside.contains([f32::NAN, -3.0, 0.5]));
    }
}
