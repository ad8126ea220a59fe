//! Which settings make sense.

use crate::{RefinerError, Settings};

impl Settings {
    /// Refuses what makes no sense, by name.
    pub fn check(&self) -> Result<(), RefinerError> {
        const LENGTH: &str = "a length above 0 and at most 100 m";
        const SHARE: &str = "a share of 0 to 1";
        const SIZES: &str = "two lengths of 0 to 100 m, the smaller one first";
        const ANGLE: &str = "an angle of 0 to 180 degrees";
        const SIDES: &str = "three lengths above 0 and at most 100 m";
        const TIMES: &str = "a factor of 0 to 20";
        let length = |v: f64| v > 0.0 && v <= 100.0;
        let share = |v: f64| (0.0..=1.0).contains(&v);
        let angle = |v: f64| (0.0..=180.0).contains(&v);
        let sizes = |[least, most]: [f64; 2]| least >= 0.0 && least <= most && most <= 100.0;
        let sides = |all: [f64; 3]| all.into_iter().all(length);
        let times = |v: f64| (0.0..=20.0).contains(&v);
        let (d, c, m) = (&self.distance, &self.corrected, &self.merge);
        let radius_m = self.radius_m.unwrap_or(1.0);
        let rules = [
            (
                "radius_m",
                LENGTH,
                radius_m,
                length(radius_m) && radius_m <= 30.0,
            ),
            (
                "length_max_m",
                LENGTH,
                self.length_max_m,
                length(self.length_max_m),
            ),
            (
                "time_max_ms",
                "a time above 0 and at most 10,000 ms",
                self.time_max_ms,
                self.time_max_ms > 0.0 && self.time_max_ms <= 10_000.0,
            ),
            (
                "ground.radius_m",
                "1 to 12 m",
                self.ground.radius_m,
                (1.0..=12.0).contains(&self.ground.radius_m),
            ),
            (
                "ground.clearance_m",
                LENGTH,
                self.ground.clearance_m,
                length(self.ground.clearance_m),
            ),
            (
                "ground.height_max_m",
                LENGTH,
                self.ground.height_max_m,
                length(self.ground.height_max_m),
            ),
            (
                "hull.length_m",
                SIZES,
                self.hull.length_m[0],
                sizes(self.hull.length_m),
            ),
            (
                "hull.width_m",
                SIZES,
                self.hull.width_m[0],
                sizes(self.hull.width_m),
            ),
            (
                "hull.height_m",
                SIZES,
                self.hull.height_m[0],
                sizes(self.hull.height_m),
            ),
            (
                "hull.post_side_m",
                LENGTH,
                self.hull.post_side_m,
                length(self.hull.post_side_m),
            ),
            (
                "hull.post_height_m",
                LENGTH,
                self.hull.post_height_m,
                length(self.hull.post_height_m),
            ),
            (
                "literal.neighbour_m",
                LENGTH,
                self.literal.neighbour_m,
                length(self.literal.neighbour_m),
            ),
            (
                "literal.angle_max_deg",
                ANGLE,
                self.literal.angle_max_deg,
                angle(self.literal.angle_max_deg),
            ),
            (
                "literal.nms_iou",
                SHARE,
                self.literal.nms_iou,
                share(self.literal.nms_iou),
            ),
            (
                "corrected.angle_min_deg",
                ANGLE,
                c.angle_min_deg,
                angle(c.angle_min_deg),
            ),
            (
                "corrected.gap_pixels",
                "at most 16 pixels",
                c.gap_pixels.into(),
                c.gap_pixels <= 16,
            ),
            (
                "corrected.fallback_m",
                LENGTH,
                c.fallback_m,
                length(c.fallback_m),
            ),
            (
                "corrected.fallback_per_range",
                SHARE,
                c.fallback_per_range,
                share(c.fallback_per_range),
            ),
            ("distance.join_m", LENGTH, d.join_m, length(d.join_m)),
            (
                "distance.join_per_range",
                SHARE,
                d.join_per_range,
                share(d.join_per_range),
            ),
            (
                "distance.join_max_m",
                LENGTH,
                d.join_max_m,
                length(d.join_max_m),
            ),
            (
                "distance.shrink_factor",
                "a factor above 0.1 and below 1",
                d.shrink_factor,
                d.shrink_factor > 0.1 && d.shrink_factor < 1.0,
            ),
            (
                "distance.shrink_attempts",
                "at most 10 attempts",
                d.shrink_attempts.into(),
                d.shrink_attempts <= 10,
            ),
            (
                "distance.width_share_min",
                SHARE,
                d.width_share_min,
                share(d.width_share_min),
            ),
            (
                "distance.width_most_m",
                LENGTH,
                d.width_most_m,
                length(d.width_most_m),
            ),
            (
                "distance.tall_from_m",
                LENGTH,
                d.tall_from_m,
                length(d.tall_from_m),
            ),
            (
                "distance.shrink_above_m",
                SIDES,
                d.shrink_above_m[0],
                sides(d.shrink_above_m),
            ),
            (
                "distance.tall_above_m",
                SIDES,
                d.tall_above_m[0],
                sides(d.tall_above_m),
            ),
            (
                "distance.upright_apart_m",
                SIDES,
                d.upright_apart_m[0],
                sides(d.upright_apart_m),
            ),
            (
                "distance.end_face_width_m",
                SIZES,
                d.end_face_width_m[0],
                sizes(d.end_face_width_m),
            ),
            (
                "distance.end_face_aside_max_deg",
                ANGLE,
                d.end_face_aside_max_deg,
                angle(d.end_face_aside_max_deg),
            ),
            (
                "distance.end_face_share",
                TIMES,
                d.end_face_share,
                times(d.end_face_share),
            ),
            (
                "distance.end_face_top_share_min",
                SHARE,
                d.end_face_top_share_min,
                share(d.end_face_top_share_min),
            ),
            (
                "distance.truck_height_min_m",
                LENGTH,
                d.truck_height_min_m,
                length(d.truck_height_min_m),
            ),
            (
                "distance.truck_end_share",
                TIMES,
                d.truck_end_share,
                times(d.truck_end_share),
            ),
            (
                "distance.cut_top_height_m",
                "a height of 0 to 10 m",
                d.cut_top_height_m,
                (0.0..=10.0).contains(&d.cut_top_height_m),
            ),
            (
                "distance.upright_scale",
                "a factor of 0 to 1",
                d.upright_scale,
                share(d.upright_scale),
            ),
            (
                "reference.tolerance_m",
                LENGTH,
                self.reference.tolerance_m,
                length(self.reference.tolerance_m),
            ),
            (
                "reference.epsilon_m",
                LENGTH,
                self.reference.epsilon_m,
                length(self.reference.epsilon_m),
            ),
            (
                "merge.overlap_max",
                SHARE,
                m.overlap_max,
                share(m.overlap_max),
            ),
            (
                "merge.known_score_min",
                SHARE,
                m.known_score_min.into(),
                share(m.known_score_min.into()),
            ),
            (
                "merge.known_points_share",
                SHARE,
                m.known_points_share,
                share(m.known_points_share),
            ),
            (
                "merge.known_margin_m",
                "0 to 1 m",
                m.known_margin_m,
                (0.0..=1.0).contains(&m.known_margin_m),
            ),
            ("merge.known_iou", SHARE, m.known_iou, share(m.known_iou)),
        ];
        match rules.into_iter().find(|(.., fine)| !fine) {
            Some((name, expected, found, _)) => Err(RefinerError::Setting {
                name,
                expected,
                found,
            }),
            None => Ok(()),
        }
    }
}
