//! Simulates a sensor with fewer beams or less range: beam dropout and range dropout.

use mluc_geometry::Random;

/// Share of the scans that lose beams; the same share loses range.
const CHANCE: f64 = 0.25;
/// Range of the height of an elevation band, radians; beams are dropped by band, and a band has one or several beams.
const BAND_RAD: [f64; 2] = [0.002, 0.012];
/// Range of the share of bands that stay.
const KEPT: [f64; 2] = [0.25, 0.8];
/// Range at which half of the points are lost, m.
const HALF_RANGE_M: [f64; 2] = [20.0, 60.0];

/// Drops beams and far points of some scans. `points`: x, y, z (m, sensor frame), intensity.
pub fn thin(points: &mut Vec<[f32; 4]>, random: &mut Random) {
    if random.uniform(0.0, 1.0) < CHANCE {
        let band_rad = random.uniform(BAND_RAD[0], BAND_RAD[1]) as f32;
        let kept = random.uniform(KEPT[0], KEPT[1]);
        let bands = (std::f32::consts::PI / band_rad).ceil() as usize + 1;
        let stays: Vec<bool> = (0..bands).map(|_| random.uniform(0.0, 1.0) < kept).collect();
        points.retain(|[x, y, z, _]| {
            let elevation_rad = z.atan2(x.hypot(*y)) + std::f32::consts::FRAC_PI_2;
            stays[(elevation_rad / band_rad) as usize]
        });
    }
    if random.uniform(0.0, 1.0) < CHANCE {
        let half_m = random.uniform(HALF_RANGE_M[0], HALF_RANGE_M[1]);
        points.retain(|[x, y, z, _]| {
            let share = f64::from(x.hypot(*y).hypot(*z)) / half_m;
            random.uniform(0.0, 1.0) < 1.0 / (1.0 + share.powi(4))
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sixteen beams 2 degrees apart, a point per degree and beam, 4 to 80 m away.
    #[test]
    fn whole_beams_and_far_points_go() {
        let point = |(beam, azimuth): (usize, usize)| {
            let elevation_rad = (beam as f32 * 2.0 - 15.0).to_radians();
            let azimuth_rad = (azimuth as f32).to_radians();
            let range_m = if azimuth % 2 == 0 { 4.0 } else { 80.0 };
            let (sin, cos) = elevation_rad.sin_cos();
            let [x, y] = [azimuth_rad.cos(), azimuth_rad.sin()].map(|v| v * cos * range_m);
            [x, y, range_m * sin, beam as f32]
        };
        let places = (0..16).flat_map(|beam| (0..360).map(move |azimuth| (beam, azimuth)));
        let all: Vec<[f32; 4]> = places.map(point).collect();
        let (mut beams_lost, mut reach_lost, mut untouched) = (0, 0, 0);
        for seed in 0..200 {
            let mut points = all.clone();
            thin(&mut points, &mut Random::new(seed, &[]));
            let of = |beam: usize, near: bool| {
                let is = |p: &&[f32; 4]| p[3] == beam as f32 && (p[0].hypot(p[1]) < 10.0) == near;
                points.iter().filter(is).count()
            };
            let near: Vec<usize> = (0..16).map(|beam| of(beam, true)).collect();
            let far: usize = (0..16).map(|beam| of(beam, false)).sum();
            assert!(near.iter().all(|n| *n == 0 || *n > 170), "whole beams: {near:?}");
            beams_lost += usize::from(near.contains(&0));
            reach_lost += usize::from(far * 2 < near.iter().sum());
            untouched += usize::from(points.len() == all.len());
        }
        assert!((20..80).contains(&beams_lost), "{beams_lost}");
        assert!((20..80).contains(&reach_lost), "{reach_lost}");
        assert!(untouched > 80, "{untouched}");
    }
}
