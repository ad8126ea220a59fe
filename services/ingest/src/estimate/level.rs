//! Finds the ground: the plane that the lowest points of most tiles share.

use mluc_geometry::ground::{GroundPlane, Lowest};

/// Tiles farther than this from the sensor are ignored, m.
const RADIUS_M: f64 = 20.0;
/// The most tiles in the square with this half side.
const TILES_MAX: usize = 1764;
/// Steps of slope that are tried first: up to 17 degrees to each side.
const SLOPE_STEPS: i32 = 6;
/// Heights that are tried first, m: a sensor may hang upside down.
const Z_M: std::ops::Range<f32> = -9.0..9.0;
const Z_STEP_M: f32 = 0.15;
/// Largest distances from the last plane, m: the next plane is fitted to the tiles within them.
const BANDS_M: [f64; 4] = [0.35, 0.25, 0.2, 0.15];
/// A floor below a roof is the ground if it has the first share of the tiles below the sensor, and the second number of tiles per tile of the roof
/// or a roof that is the third number of times as far away. Upside down, the few beams above the sensor see a thin layer, which looks like a floor:
/// so a near roof also needs a share of the points below the sensor. Guesses.
const FLOOR_SHARE: f32 = 0.4;
const FLOOR_TILES: f32 = 0.8;
const ROOF_FARTHER: f32 = 1.5;
const HIGH_ROOF_M: f32 = 3.2;
const BELOW_SHARE: f32 = 0.33;

/// The ground.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Level {
    pub(super) plane: GroundPlane,
    /// Share of the tiles that lie on the plane.
    pub(super) share: f32,
    /// Number of these tiles.
    tiles: usize,
}

impl Level {
    /// Height of the plane at the sensor, m.
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
        let tiles = tiles.filter(|&tile| is_near(plane.above_m(tile), BANDS_M[3])).count();
        let share = tiles as f32 / self.tiles.len() as f32;
        Some(Level { plane, share, tiles })
    }

    /// The ground of scans whose z should point up. Of a floor and a roof it is the floor. In an upside-down scan the uppermost beams
    /// hit a smaller area than the ground's.
    pub(super) fn below(&mut self, scan: impl Iterator<Item = [f32; 3]> + Clone) -> Option<Level> {
        let level = self.find(scan.clone())?;
        if level.z_m() < 0.0 {
            return Some(level);
        }
        let is_below = |[.., z]: &[f32; 3]| *z < 0.0;
        let (all, below) = (scan.clone().count(), scan.clone().filter(is_below).count());
        let floor = self.find(scan.filter(is_below));
        let is_one = |floor: &Level| {
            let is_floor = level.z_m() > HIGH_ROOF_M || below as f32 > BELOW_SHARE * all as f32;
            let is_nearer = is_floor && level.z_m() > ROOF_FARTHER * floor.z_m().abs();
            let is_large = floor.tiles as f32 >= FLOOR_TILES * level.tiles as f32;
            floor.share >= FLOOR_SHARE && (is_nearer || is_large)
        };
        floor.filter(is_one).or(Some(level))
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
        // A floor below a roof that more beams see.
        let roof = (0..10_000).map(point).map(|[x, y, _]| [x, y, 4.0]);
        let floor = (0..10_000).map(point).filter(|[x, y, _]| x.hypot(*y) > 14.0);
        let level = finder.below(roof.chain(floor)).expect("a plane");
        assert!((level.plane.z_m + 0.8).abs() < 0.1, "{level:?}");
    }
}
