//! Where the ground is: the plane that most of the tiles' lowest points share.

use mluc_geometry::ground::{GroundPlane, Lowest};

/// Tiles farther than this from the sensor have no say, m.
const RADIUS_M: f64 = 20.0;
/// All tiles of that square.
const TILES_MAX: usize = 1764;
/// Slopes that are tried first: 17 degrees to each side.
const SLOPE_STEPS: i32 = 6;
/// And heights, m: a sensor may hang upside down.
const Z_M: std::ops::Range<f32> = -9.0..9.0;
const Z_STEP_M: f32 = 0.15;
/// Tiles this near the last plane carry the next, m.
const BANDS_M: [f64; 4] = [0.35, 0.25, 0.2, 0.15];

/// The ground.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Level {
    pub(super) plane: GroundPlane,
    /// Share of the tiles that lie on it.
    pub(super) share: f32,
}

impl Level {
    /// At the sensor, m.
    pub(super) fn z_m(&self) -> f32 {
        self.plane.z_m as f32
    }
}

/// Finds planes; buffers are reused.
#[derive(Clone, Debug, Default)]
pub(super) struct LevelFinder {
    lowest: Lowest,
    tiles: Vec<[f32; 3]>,
}

impl LevelFinder {
    /// The ground of points x, y, z, m; `None` where too few tiles agree.
    pub(super) fn find(&mut self, points: impl Iterator<Item = [f32; 3]>) -> Option<Level> {
        self.lowest.find(points);
        self.tiles.clear();
        self.tiles.reserve(TILES_MAX);
        let around = self.lowest.around([0.0; 2], RADIUS_M);
        self.tiles.extend(around.take(TILES_MAX));
        let tiles = self.tiles.iter().copied();
        let start = GroundPlane::common(tiles.clone(), SLOPE_STEPS, Z_M, Z_STEP_M)?;
        let is_near = |above_m: f64, band_m: f64| above_m.abs() <= band_m;
        let weight = |above_m, band_m| f64::from(is_near(above_m, band_m));
        let plane = start.fitted(tiles.clone(), &BANDS_M, weight, 0.0);
        let near = tiles.filter(|&tile| is_near(plane.above_m(tile), BANDS_M[3]));
        let share = near.count() as f32 / self.tiles.len() as f32;
        Some(Level { plane, share })
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
            let is_thing = i % 3 == 0 && i % 700 > 350;
            let above = if is_thing { (i % 17) as f32 * 0.2 } else { 0.0 };
            [x, y, -0.8 + 0.17 * x - 0.05 * y + above]
        };
        let level = finder.find((0..10_000).map(point)).expect("a plane");
        let (z_m, [x, y]) = (level.plane.z_m, level.plane.slope);
        assert!((z_m + 0.8).abs() < 0.1, "{level:?}");
        assert!((x - 0.17).abs() < 0.01 && (y + 0.05).abs() < 0.01);
        assert_eq!(finder.find([[f32::NAN; 3]].into_iter()), None);
    }
}
