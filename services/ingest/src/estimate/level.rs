//! Where the ground is: the plane that most of the tiles' lowest points share.

use mluc_geometry::ground::Lowest;
use nalgebra::{Matrix3, Vector3};

/// Tiles farther than this from the sensor have no say, m.
const RADIUS_M: f64 = 20.0;
/// All tiles of that square.
const TILES_MAX: usize = 1764;
/// Fewer tiles carry no plane.
const TILES_MIN: usize = 16;
/// Slopes that are tried first, and their steps to each side: 17 degrees.
const SLOPE_STEP: f32 = 0.05;
const SLOPE_STEPS: i32 = 6;
/// Heights that are tried with them, m.
const HEIGHT_STEP_M: f32 = 0.15;
const HEIGHT_MAX_M: f32 = 9.0;
const HEIGHTS: usize = (2.0 * HEIGHT_MAX_M / HEIGHT_STEP_M) as usize;
/// Tiles this near the last plane carry the next, m.
const BANDS_M: [f32; 4] = [0.35, 0.25, 0.2, 0.15];

/// z = `z_m` + slope . (x, y).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Level {
    /// At the sensor, m.
    pub(super) z_m: f32,
    /// dz/dx and dz/dy.
    pub(super) slope: [f32; 2],
    /// Share of the tiles that lie on it.
    pub(super) share: f32,
}

/// Finds planes; all memory is made once.
#[derive(Clone, Debug)]
pub(super) struct LevelFinder {
    lowest: Lowest,
    tiles: Vec<[f32; 3]>,
}

impl Default for LevelFinder {
    fn default() -> LevelFinder {
        LevelFinder {
            lowest: Lowest::default(),
            tiles: Vec::with_capacity(TILES_MAX),
        }
    }
}

impl LevelFinder {
    /// The ground of points x, y, z, m; `None` where too few tiles agree.
    pub(super) fn find(&mut self, points: impl Iterator<Item = [f32; 3]>) -> Option<Level> {
        self.lowest.clear();
        self.lowest.add(points);
        self.tiles.clear();
        let around = self.lowest.around([0.0; 2], RADIUS_M);
        self.tiles.extend(around.take(TILES_MAX));
        let mut level = self.start()?;
        for band_m in BANDS_M {
            level = self.fit(&level, band_m).unwrap_or(level);
        }
        level.share = self.near(&level, BANDS_M[3]).count() as f32 / self.tiles.len() as f32;
        Some(level)
    }

    /// The best plane of a coarse grid of slopes and heights.
    fn start(&self) -> Option<Level> {
        let mut best = (
            0,
            Level {
                z_m: 0.0,
                slope: [0.0; 2],
                share: 0.0,
            },
        );
        for step in 0..(2 * SLOPE_STEPS + 1).pow(2) {
            let side = 2 * SLOPE_STEPS + 1;
            let slope = [step % side, step / side].map(|s| (s - SLOPE_STEPS) as f32 * SLOPE_STEP);
            let mut counts = [0u16; HEIGHTS];
            for [x, y, z] in &self.tiles {
                let z_m = z - slope[0] * x - slope[1] * y;
                let bin = (z_m + HEIGHT_MAX_M) / HEIGHT_STEP_M;
                if (0.0..HEIGHTS as f32).contains(&bin) {
                    counts[bin as usize] += 1;
                }
            }
            for (bin, pair) in counts.windows(2).enumerate() {
                let count = pair[0] + pair[1];
                if count > best.0 {
                    let z_m = (bin + 1) as f32 * HEIGHT_STEP_M - HEIGHT_MAX_M;
                    best = (
                        count,
                        Level {
                            z_m,
                            slope,
                            share: 0.0,
                        },
                    );
                }
            }
        }
        (usize::from(best.0) >= TILES_MIN).then_some(best.1)
    }

    fn near(&self, level: &Level, band_m: f32) -> impl Iterator<Item = &[f32; 3]> {
        let Level { z_m, slope, .. } = *level;
        let off = move |p: &[f32; 3]| (p[2] - z_m - slope[0] * p[0] - slope[1] * p[1]).abs();
        self.tiles.iter().filter(move |p| off(p) <= band_m)
    }

    /// Least squares through the tiles near the last plane.
    fn fit(&self, last: &Level, band_m: f32) -> Option<Level> {
        let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
        for &[x, y, z] in self.near(last, band_m) {
            let row = Vector3::new(f64::from(x), f64::from(y), 1.0);
            normal += row * row.transpose();
            right += f64::from(z) * row;
        }
        let found = normal.cholesky()?.solve(&right);
        let [x, y, z] = [found[0], found[1], found[2]].map(|v| v as f32);
        let is_sound = x.hypot(y) < 1.0 && z.is_finite();
        is_sound.then_some(Level {
            z_m: z,
            slope: [x, y],
            share: 0.0,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tilted_ground_is_found_among_boxes() {
        let mut finder = LevelFinder::default();
        let point = |i: i32| {
            let (x, y) = ((i % 100) as f32 * 0.4 - 20.0, (i / 100) as f32 * 0.4 - 20.0);
            // A third of the area is covered by things of different heights.
            let above = if i % 3 == 0 && i % 700 > 350 {
                (i % 17) as f32 * 0.2
            } else {
                0.0
            };
            [x, y, -0.8 + 0.17 * x - 0.05 * y + above]
        };
        let level = finder.find((0..10_000).map(point)).expect("a plane");
        assert!((level.z_m + 0.8).abs() < 0.1, "{level:?}");
        assert!((level.slope[0] - 0.17).abs() < 0.01 && (level.slope[1] + 0.05).abs() < 0.01);
        assert_eq!(finder.find([[f32::NAN; 3]].into_iter()), None);
    }
}
