//! Does a scan look like what the model was trained for? "No boxes and no error" is the commonest complaint about
//! detectors, and its causes are few: another intensity scale, another height of the sensor.

use mluc_ipc_types::Point;
use mluc_model::Manifest;

/// Something that does not fit the model.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Finding {
    /// Intensities beyond 1: probably 0 to 255.
    #[error("intensities up to {max}, the model expects 0 to 1")]
    IntensityScale {
        /// The largest.
        max: f32,
    },
    /// All intensities are 0, and the network reads them.
    #[error("all intensities are 0, the model reads them")]
    IntensityMissing,
    /// The ground lies elsewhere than the sensor height of the model says.
    #[error(
        "ground at z = {found_z_m:.1} m, the model expects {expected_z_m:.1} m: is the sensor mounted at another height?"
    )]
    GroundHeight {
        /// By the model, m.
        expected_z_m: f32,
        /// In the scan, m.
        found_z_m: f32,
    },
}

/// Scans with fewer points are not judged: a guess; a full scan has 60,000 to 130,000.
const POINTS_MIN: usize = 5_000;
/// A few wrong returns are no other scale.
const INTENSITY_MAX: f32 = 1.001;
/// Ground is looked for at these distances, m: beyond the vehicle itself, near enough for the ground to be level.
const GROUND_RANGE_M: std::ops::Range<f32> = 4.0..18.0;
/// Histogram of heights, m.
const GROUND_Z_M: std::ops::Range<f32> = -5.0..3.0;
const GROUND_STEP_M: f32 = 0.1;
/// Lasting deviation that matters to the anchors (measured by others: 0.5 m costs most of the recall).
const GROUND_TOLERANCE_M: f32 = 0.5;

/// Checks scans against one model.
#[derive(Clone, Debug)]
pub struct Sanity {
    ground_z_m: f32,
    uses_intensity: bool,
}

impl Sanity {
    /// What the model was trained for.
    pub fn new(manifest: &Manifest) -> Sanity {
        Sanity {
            ground_z_m: -manifest.sensor_height_m,
            uses_intensity: manifest.uses_intensity,
        }
    }

    /// The first thing that does not fit.
    pub fn check(&self, points: &[Point]) -> Option<Finding> {
        if points.len() < POINTS_MIN {
            return None;
        }
        self.check_intensity(points)
            .or_else(|| self.check_ground(points))
    }

    fn check_intensity(&self, points: &[Point]) -> Option<Finding> {
        if !self.uses_intensity {
            return None;
        }
        match points.iter().map(|p| p.intensity).fold(0.0, f32::max) {
            0.0 => Some(Finding::IntensityMissing),
            max if max > INTENSITY_MAX => Some(Finding::IntensityScale { max }),
            _ => None,
        }
    }

    fn check_ground(&self, points: &[Point]) -> Option<Finding> {
        let (found_z_m, expected_z_m) = (ground_z_m(points)?, self.ground_z_m);
        let is_off = (found_z_m - expected_z_m).abs() > GROUND_TOLERANCE_M;
        is_off.then_some(Finding::GroundHeight {
            expected_z_m,
            found_z_m,
        })
    }
}

/// The height where most of the near points lie; none when no height stands out.
fn ground_z_m(points: &[Point]) -> Option<f32> {
    const BINS: usize = ((GROUND_Z_M.end - GROUND_Z_M.start) / GROUND_STEP_M) as usize;
    let mut count = [0u32; BINS];
    let mut near = 0;
    for p in points {
        let range_m = p.x_m.hypot(p.y_m);
        if GROUND_RANGE_M.contains(&range_m) && GROUND_Z_M.contains(&p.z_m) {
            let bin = ((p.z_m - GROUND_Z_M.start) / GROUND_STEP_M) as usize;
            count[bin.min(BINS - 1)] += 1;
            near += 1;
        }
    }
    // Three neighbouring bins, as the ground is seldom level to 0.1 m; of equal sums the one whose middle is fullest.
    let sums = count.windows(3).enumerate();
    let sums = sums.map(|(bin, three)| (bin, three.iter().sum::<u32>(), three[1]));
    let (bin, most, _) = sums.max_by_key(|&(_, sum, middle)| (sum, middle))?;
    // A guess: walls spread over all heights, ground does not.
    let stands_out = most as usize > POINTS_MIN / 10 && most * 4 > near;
    stands_out.then_some(GROUND_Z_M.start + (bin as f32 + 1.5) * GROUND_STEP_M)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scan(ground_z_m: f32, intensity: f32) -> Vec<Point> {
        let point = |number: i32| {
            let (angle, range) = (number as f32 * 0.01, 5.0 + (number % 100) as f32 * 0.1);
            // Every third point stands on something.
            let standing = (number % 3 == 0).then(|| -1.0 + (number % 30) as f32 * 0.05);
            Point {
                x_m: range * angle.cos(),
                y_m: range * angle.sin(),
                z_m: standing.unwrap_or(ground_z_m),
                intensity: intensity * ((number % 7) as f32 / 6.0),
            }
        };
        (0..20_000).map(point).collect()
    }

    const KITTI: Sanity = Sanity {
        ground_z_m: -1.73,
        uses_intensity: true,
    };

    #[test]
    fn what_is_not_like_the_training_data_is_found() {
        let scale = Finding::IntensityScale { max: 255.0 };
        let blind = Sanity {
            uses_intensity: false,
            ..KITTI
        };
        for (sanity, points, expected) in [
            (&KITTI, &scan(-1.7, 0.9)[..], None),
            // Too few to judge.
            (&KITTI, &scan(-1.7, 255.0)[..100], None),
            (&KITTI, &scan(-1.7, 255.0), Some(scale)),
            (&KITTI, &scan(-1.7, 0.0), Some(Finding::IntensityMissing)),
            (&blind, &scan(-1.7, 255.0), None),
        ] {
            assert_eq!(sanity.check(points), expected);
        }
        let Some(Finding::GroundHeight { found_z_m, .. }) = KITTI.check(&scan(-0.6, 0.9)) else {
            panic!("another mounting height is not seen");
        };
        assert!((found_z_m + 0.6).abs() < 0.15, "{found_z_m}");
    }
}
