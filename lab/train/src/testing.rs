//! Compares gradients with finite differences, for the tests of this crate.

/// Steps of a central difference: a large one crosses ReLU's kinks, a small one has rounding errors, so agreement at any step is enough.
const STEPS: [f32; 5] = [4e-3, 2e-3, 1e-3, 2e-4, 5e-5];

/// Panics unless the derivative of `value` at 0 is `slope` (within `tolerance`, of 1 + the slope).
pub(crate) fn assert_slope(name: &str, slope: f64, tolerance: f64, value: impl Fn(f32) -> f64) {
    let found = STEPS.map(|h| (value(h) - value(-h)) / (2.0 * f64::from(h)));
    let agrees = |found: &f64| (found - slope).abs() < tolerance * (1.0 + found.abs());
    assert!(found.iter().any(agrees), "{name}: {found:?} against {slope}");
}

/// Panics unless `gradient` is the gradient of `value` at `x`.
pub(crate) fn assert_gradient(
    name: &str,
    x: &[f32],
    gradient: &[f32],
    tolerance: f64,
    value: impl Fn(&[f32]) -> f64,
) {
    for (i, slope) in gradient.iter().enumerate() {
        assert_slope(&format!("{name} {i}"), f64::from(*slope), tolerance, |h| {
            let mut x = x.to_vec();
            x[i] += h;
            value(&x)
        });
    }
}
