//! The angle of the joining rule (paper algorithm 1; Bogoslavskyi and Stachniss, 2016).
//!
//! Between the line from the farther point to the nearer one and the ray to the farther point: near 90 degrees on a
//! face seen frontally, near 0 across a jump in depth. The paper writes it as the law of cosines, depth clustering as
//! atan2(d2 sin a, d1 - d2 cos a); both are the same angle.

/// Whether the angle between two points is above a threshold given as its cosine, without the arc cosine.
pub(crate) fn is_above(s_m: [f32; 3], t_m: [f32; 3], threshold_cosine: f32) -> bool {
    let square = |p: [f32; 3]| p[0] * p[0] + p[1] * p[1] + p[2] * p[2];
    let (s2, t2) = (square(s_m), square(t_m));
    let (long2, short2) = if s2 > t2 { (s2, t2) } else { (t2, s2) };
    let d2 = square([s_m[0] - t_m[0], s_m[1] - t_m[1], s_m[2] - t_m[2]]);
    // Equal points count as a quarter turn.
    if d2 == 0.0 {
        return threshold_cosine > 0.0;
    }
    long2 + d2 - short2 < threshold_cosine * 2.0 * (d2 * long2).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Angle at the farther of two points, rad, by the law of cosines as the paper prints it. Points in the sensor frame,
    /// m. Equal points: a quarter turn, as on a frontal face; a point in the origin: 0.
    fn by_law_of_cosines_rad(s_m: [f64; 3], t_m: [f64; 3]) -> f64 {
        let (s_range, t_range) = (norm(s_m), norm(t_m));
        let (long, short) = (s_range.max(t_range), s_range.min(t_range));
        let d = norm([0, 1, 2].map(|i| s_m[i] - t_m[i]));
        if d == 0.0 {
            return std::f64::consts::FRAC_PI_2;
        }
        let cosine = (long * long + d * d - short * short) / (2.0 * d * long);
        cosine.clamp(-1.0, 1.0).acos()
    }

    /// The same angle, rad, from two ranges and the angle between the rays.
    fn by_arctangent_rad(long_m: f64, short_m: f64, between_rays_rad: f64) -> f64 {
        let (sin, cos) = between_rays_rad.sin_cos();
        (short_m * sin).atan2(long_m - short_m * cos)
    }

    fn norm(p: [f64; 3]) -> f64 {
        (p[0] * p[0] + p[1] * p[1] + p[2] * p[2]).sqrt()
    }

    fn angle_between(a: [f64; 3], b: [f64; 3]) -> f64 {
        let dot: f64 = (0..3).map(|i| a[i] * b[i]).sum();
        let cross = [
            a[1] * b[2] - a[2] * b[1],
            a[2] * b[0] - a[0] * b[2],
            a[0] * b[1] - a[1] * b[0],
        ];
        norm(cross).atan2(dot)
    }

    #[test]
    fn both_forms_agree() {
        for i in 1..500 {
            let f = |k: f64| (f64::from(i) * k).sin();
            let s = [10.0 + 3.0 * f(0.7), 4.0 * f(1.3), f(2.1)];
            let t = [10.0 + 3.0 * f(1.9), 4.0 * f(0.4), f(3.3)];
            let (long, short) = (norm(s).max(norm(t)), norm(s).min(norm(t)));
            let expected = by_arctangent_rad(long, short, angle_between(s, t));
            let found = by_law_of_cosines_rad(s, t);
            assert!((found - expected).abs() < 1e-9, "{found} {expected}");
            let threshold = 25f64.to_radians();
            if (found - threshold).abs() > 1e-3 {
                let single = |p: [f64; 3]| p.map(|v| v as f32);
                assert_eq!(
                    is_above(single(s), single(t), threshold.cos() as f32),
                    found > threshold
                );
            }
        }
    }

    #[test]
    fn a_frontal_face_is_near_90_degrees_and_a_jump_near_0() {
        let face = by_law_of_cosines_rad([10.0, 0.0, 0.0], [10.0, 0.03, 0.0]).to_degrees();
        assert!((face - 90.0).abs() < 1.0, "{face}");
        let jump = by_law_of_cosines_rad([10.0, 0.0, 0.0], [20.0, 0.06, 0.0]).to_degrees();
        assert!(jump < 1.0, "{jump}");
    }

    #[test]
    fn degenerate_points_give_a_number() {
        assert_eq!(
            by_law_of_cosines_rad([1.0, 2.0, 3.0], [1.0, 2.0, 3.0]),
            std::f64::consts::FRAC_PI_2
        );
        assert!(by_law_of_cosines_rad([0.0; 3], [1.0, 0.0, 0.0]).is_finite());
        assert!(is_above([1.0; 3], [1.0; 3], 0.98));
    }
}
