//! The angle of the joining rule (paper algorithm 1; Bogoslavskyi and Stachniss, 2016).
//!
//! It lies between the line from the farther point to the nearer one and the ray to the farther point: near 90 degrees on a face seen frontally,
//! near 0 across a jump in depth. The paper uses the law of cosines, depth clustering atan2(d2 sin a, d1 - d2 cos a); both give the same angle.

/// Whether the angle between two points is above a threshold, which is given as its cosine; computed without the arc cosine.
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
    use nalgebra::Vector3;

    /// Angle at the farther of two points, rad: by the law of cosines as the paper prints it, and from two ranges and the angle between the rays.
    fn both_forms_rad(s: Vector3<f64>, t: Vector3<f64>) -> [f64; 2] {
        let (long, short) = (s.norm().max(t.norm()), s.norm().min(t.norm()));
        let d = (s - t).norm();
        let cosine = (long * long + d * d - short * short) / (2.0 * d * long);
        let (sin, cos) = s.angle(&t).sin_cos();
        let by_arctangent = (short * sin).atan2(long - short * cos);
        [cosine.clamp(-1.0, 1.0).acos(), by_arctangent]
    }

    fn is_above_deg(s: Vector3<f64>, t: Vector3<f64>, degrees: f64) -> bool {
        let [s, t] = [s, t].map(|p| p.map(|v| v as f32).into());
        is_above(s, t, degrees.to_radians().cos() as f32)
    }

    #[test]
    fn both_forms_of_the_angle_agree_and_are_compared() {
        for i in 1..500 {
            let f = |k: f64| (f64::from(i) * k).sin();
            let s = Vector3::new(10.0 + 3.0 * f(0.7), 4.0 * f(1.3), f(2.1));
            let t = Vector3::new(10.0 + 3.0 * f(1.9), 4.0 * f(0.4), f(3.3));
            let [found, expected] = both_forms_rad(s, t);
            assert!((found - expected).abs() < 1e-6, "{found} {expected}");
            let is_close = (found.to_degrees() - 25.0).abs() < 0.06;
            assert!(is_close || is_above_deg(s, t, 25.0) == (found.to_degrees() > 25.0));
            // Equal points count as a quarter turn.
            assert!(is_above_deg(s, s, 89.9) && !is_above_deg(s, s, 90.1));
        }
    }
}
