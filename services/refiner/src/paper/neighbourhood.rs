//! The points around one candidate's seed, in columns, relative to the seed.

use crate::frame::{FrameIndex, IndexedPoint};
use mluc_geometry::ground::ground_height_m;

/// Points within a cylinder around a seed. Columns of equal length.
#[derive(Debug, Default)]
pub struct Neighbourhood {
    /// x and y of the seed, m: the origin of `x_m` and `y_m`.
    pub origin_m: [f64; 2],
    /// x relative to the origin, m.
    pub x_m: Vec<f32>,
    /// y relative to the origin, m.
    pub y_m: Vec<f32>,
    /// z in the sensor frame, m.
    pub z_m: Vec<f32>,
    /// Height above the local ground, m; if the ground is not estimated, above a level plane at the sensor's height below it.
    pub height_m: Vec<f32>,
    /// Index into the scan.
    pub index: Vec<u32>,
    /// Number of points read to fill the columns, which is the work.
    pub looked_at: u64,
    /// Whether points were left out because of the limit.
    pub thinned: bool,
    /// Buffer of [`Neighbourhood::gather`].
    picked: Vec<IndexedPoint>,
}

/// Maximum number of points for one candidate; more are thinned evenly, counted and flagged. A car at 4 m has about 10,000.
const POINTS_MAX: usize = 16_384;

impl Neighbourhood {
    pub(crate) fn len(&self) -> usize {
        self.index.len()
    }

    /// A point in the sensor frame, m.
    pub fn in_sensor_m(&self, point: usize) -> [f64; 3] {
        let columns = [&self.x_m, &self.y_m, &self.z_m];
        let [x, y, z] = columns.map(|column| f64::from(column[point]));
        [self.origin_m[0] + x, self.origin_m[1] + y, z]
    }

    /// Fills the columns with the points within `radius_m` of a seed, seen from above (m; r of the paper); returns the seed's index among them.
    pub(crate) fn gather(
        &mut self,
        frame: &FrameIndex,
        seed: &IndexedPoint,
        ground_m: &[f32],
        radius_m: f64,
    ) -> usize {
        let [seed_x, seed_y, _] = seed.at_m;
        let center_m = [f64::from(seed_x), f64::from(seed_y)];
        let rows = || frame.rows_around(center_m, radius_m);
        let available: usize = rows().map(<[IndexedPoint]>::len).sum();
        self.looked_at = available as u64;
        let radius_squared = (radius_m * radius_m) as f32;
        let height = |[x, y, z]: [f32; 3]| z - ground_height_m(ground_m, [x, y]);
        let is_asked = |at_m: [f32; 3]| {
            let (dx, dy) = (at_m[0] - seed_x, at_m[1] - seed_y);
            dx * dx + dy * dy <= radius_squared
        };
        // Only points within the radius count against the limit: near the sensor most points are ground.
        let mut keep_one_in = 1;
        if available > POINTS_MAX {
            self.looked_at += available as u64;
            let asked = rows().flatten().filter(|p| is_asked(p.at_m)).count();
            keep_one_in = asked.div_ceil(POINTS_MAX) as u64;
        }
        self.thinned = keep_one_in > 1;
        let mut count = 0;
        let picked = &mut self.picked;
        picked.resize(picked.len().max(available), IndexedPoint::default());
        for point in rows().flatten() {
            // Thousands of equal points are kept or dropped together.
            let stays =
                keep_one_in <= 1 || (count < 2 * POINTS_MAX && is_kept(point.at_m, keep_one_in));
            // The next point overwrites one that is not picked.
            picked[count] = *point;
            count += usize::from((point.index == seed.index) | (is_asked(point.at_m) & stays));
        }
        let picked = &picked[..count];
        self.origin_m = center_m;
        fill(&mut self.x_m, picked, |p| p.at_m[0] - seed_x);
        fill(&mut self.y_m, picked, |p| p.at_m[1] - seed_y);
        fill(&mut self.z_m, picked, |p| p.at_m[2]);
        fill(&mut self.height_m, picked, |p| height(p.at_m));
        fill(&mut self.index, picked, |p| p.index);
        self.index.iter().position(|&index| index == seed.index).unwrap_or(0)
    }
}

fn fill<T>(column: &mut Vec<T>, points: &[IndexedPoint], value: impl Fn(&IndexedPoint) -> T) {
    column.clear();
    column.extend(points.iter().map(value));
}

/// Decides by the coordinates alone whether a point is kept, so that the order of the scan does not matter.
fn is_kept(at_m: [f32; 3], keep_one_in: u64) -> bool {
    let [x, y, z] = at_m.map(|v| u64::from(v.to_bits()));
    let mixed = (x << 32 ^ z << 16 ^ y).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    (mixed >> 32).is_multiple_of(keep_one_in)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{point, sorted};
    use mluc_geometry::ground::GROUND_NODES;
    use mluc_ipc_types::Point;

    fn gather(scan: &[Point], seed: usize) -> (Neighbourhood, usize) {
        let mut around = Neighbourhood::default();
        let seed = IndexedPoint {
            at_m: [scan[seed].x_m, scan[seed].y_m, scan[seed].z_m],
            index: seed as u32,
        };
        let found = around.gather(&sorted(scan), &seed, &[-1.7; GROUND_NODES], 3.0);
        (around, found)
    }

    #[test]
    fn the_distance_selects() {
        let scan = [[10.5, 2.0, -1.0], [10.0, 2.5, -1.0], [13.7, 2.0, -1.0]];
        let (around, seed) = gather(&scan.map(point), 1);
        assert_eq!((around.len(), around.index[1 - seed]), (2, 0));
        assert_eq!(around.index[seed], 1);
        assert_eq!((around.x_m[seed], around.y_m[seed]), (0.0, 0.0));
        assert!((around.height_m[seed] - 0.7).abs() < 1e-5);
        assert!(!around.thinned);
        assert_eq!(around.in_sensor_m(seed), [10.0, 2.5, -1.0]);
    }

    #[test]
    fn thinning_keeps_about_the_limit_and_the_seed_and_ignores_the_order() {
        let places = (0..60_000).map(|i| [(i % 200) as f32 * 0.01, (i / 200) as f32 * 0.006]);
        let mut scan: Vec<Point> = places.map(|[x, y]| point([9.0 + x, 1.0 + y, -1.0])).collect();
        let set = |around: &Neighbourhood| {
            let columns = around.x_m.iter().zip(&around.y_m);
            let mut bits: Vec<_> = columns.map(|(x, y)| [x.to_bits(), y.to_bits()]).collect();
            bits.sort_unstable();
            bits
        };
        let (around, seed) = gather(&scan, 777);
        assert_eq!(around.index[seed], 777);
        assert!(around.thinned && around.looked_at >= 60_000);
        assert!((11_000..20_000).contains(&around.len()), "{}", around.len());
        scan.reverse();
        assert_eq!(set(&gather(&scan, 60_000 - 1 - 777).0), set(&around));
    }
}
