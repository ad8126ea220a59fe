//! Join distance that grows with range, seen from above: the default of the improved method.
//!
//! The gap between neighbouring beams and columns grows with range, and so does the distance within which two points
//! belong to one thing. It is fixed for a candidate by its seed's range. Points are sorted into cells whose diagonal is
//! the join distance: all points of a cell belong together, and of two cells only one pair of points must be near
//! enough. So the result equals joining point by point, and cost grows with the points and not with their pairs.

use super::{Bounds, Clusterer, is_allowed};
use crate::buckets::Buckets;
use crate::neighbourhood::Neighbourhood;
use crate::settings::DistanceSettings;

/// Range-scaled joining over bird's-eye buckets.
#[derive(Debug)]
pub struct Distance {
    join_m: f64,
    join_per_range: f64,
    join_max_m: f64,
    buckets: Buckets,
    reached: Vec<bool>,
    queue: Vec<u32>,
    /// Lowest x, y and highest x, y of each reached cell's points, m.
    extents: Vec<[f32; 4]>,
}

impl Distance {
    /// From the settings.
    pub fn new(settings: &DistanceSettings) -> Distance {
        Distance {
            join_m: settings.join_m,
            join_per_range: settings.join_per_range,
            join_max_m: settings.join_max_m,
            buckets: Buckets::default(),
            reached: Vec::new(),
            queue: Vec::new(),
            extents: Vec::new(),
        }
    }

    /// The join distance at a range, m.
    pub fn join_distance_m(&self, range_m: f64) -> f64 {
        (self.join_m + self.join_per_range * range_m).min(self.join_max_m)
    }

    /// The join distance of a growth, m.
    fn join_m(&self, range_m: f64, bounds: &Bounds) -> f32 {
        (self.join_distance_m(range_m) * bounds.scale) as f32
    }

    /// Sorts points into cells for joins of at least `join_m`; none is reached yet.
    fn sort(&mut self, around: &Neighbourhood, join_m: f32, keep: impl Fn(usize) -> bool) {
        // A little below the exact size, so that rounding cannot put two distant points into one cell.
        let cell_m = join_m * (0.999 / std::f32::consts::SQRT_2);
        self.buckets.fill(&around.x_m, &around.y_m, cell_m, keep);
        self.extents.clear();
        for cell in 0..self.buckets.cells() {
            self.extents.push(self.measure(cell));
        }
        self.reached.clear();
        self.reached.resize(self.buckets.cells(), false);
    }

    /// The points of all cells that the seed's cell reaches by steps of at most `join_m`.
    fn reach(&mut self, around: &Neighbourhood, seed: usize, join_m: f32, members: &mut Vec<u32>) {
        members.clear();
        let side = self.buckets.side();
        // Farther cells lie apart by more than the join.
        let cells = (join_m / self.buckets.cell_m()) as usize + 1;
        let near = |at: usize| at.saturating_sub(cells)..(at + cells + 1).min(side);
        let start = self.buckets.cell_at(around.x_m[seed], around.y_m[seed]);
        self.queue.clear();
        self.queue.push(start as u32);
        self.reached[start] = true;
        let mut next = 0;
        while let Some(&cell) = self.queue.get(next) {
            next += 1;
            let cell = cell as usize;
            members.extend_from_slice(self.buckets.points(cell));
            for y in near(cell / side) {
                for x in near(cell % side) {
                    let other = y * side + x;
                    if !self.reached[other]
                        && !self.buckets.points(other).is_empty()
                        && self.touch(cell, other, join_m * join_m)
                    {
                        self.reached[other] = true;
                        self.queue.push(other as u32);
                    }
                }
            }
        }
        // As it was, for the next seed.
        for &cell in &self.queue {
            self.reached[cell as usize] = false;
        }
    }

    /// Lowest x, y and highest x, y of a cell's points, m.
    fn measure(&self, cell: usize) -> [f32; 4] {
        let places = self.buckets.places(cell);
        let Some(&[x, y]) = places.first() else {
            return [f32::INFINITY; 4];
        };
        let less = |a: f32, b: f32| if a < b { a } else { b };
        let more = |a: f32, b: f32| if a > b { a } else { b };
        places[1..].iter().fold([x, y, x, y], |e, &[x, y]| {
            [less(x, e[0]), less(y, e[1]), more(x, e[2]), more(y, e[3])]
        })
    }

    /// Whether any point of one cell is within the join distance of any point of another.
    fn touch(&self, a: usize, b: usize, join_squared: f32) -> bool {
        let (ea, eb) = (self.extents[a], self.extents[b]);
        if gap_squared(ea, eb) > join_squared {
            return false;
        }
        let others = self.buckets.places(b);
        self.buckets.places(a).iter().any(|&[x, y]| {
            gap_squared([x, y, x, y], eb) <= join_squared
                && others.iter().any(|&[ox, oy]| {
                    let (dx, dy) = (ox - x, oy - y);
                    dx * dx + dy * dy <= join_squared
                })
        })
    }
}

/// Squared distance between two extents, m^2.
fn gap_squared(a: [f32; 4], b: [f32; 4]) -> f32 {
    let gap = |axis: usize| (b[axis] - a[axis + 2]).max(a[axis] - b[axis + 2]).max(0.0);
    gap(0) * gap(0) + gap(1) * gap(1)
}

impl Clusterer for Distance {
    fn grow(
        &mut self,
        around: &Neighbourhood,
        seed: usize,
        bounds: &Bounds,
        members: &mut Vec<u32>,
    ) {
        let join_m = self.join_m(around.range_m(seed), bounds);
        let allowed = is_allowed(around, seed, bounds);
        self.sort(around, join_m, |i| i == seed || allowed(i));
        self.reach(around, seed, join_m, members);
    }

    /// The points are sorted once: cells for the shortest of all joins serve the others too.
    fn grow_rest(
        &mut self,
        around: &Neighbourhood,
        bounds: &Bounds,
        is_taken: &mut [bool],
        members: &mut Vec<u32>,
        take: &mut dyn FnMut(&[u32]),
    ) {
        let ranges_m = (0..around.len()).map(|point| around.range_m(point));
        let nearest_m = ranges_m.fold(f64::INFINITY, f64::min);
        let join_m = self.join_m(nearest_m, bounds);
        self.sort(around, join_m, |_| true);
        for seed in 0..around.len() {
            if !is_taken[seed] {
                let join_m = self.join_m(around.range_m(seed), bounds);
                self.reach(around, seed, join_m, members);
                members.iter().for_each(|&m| is_taken[m as usize] = true);
                take(members);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scattered(count: usize) -> Neighbourhood {
        let mut around = Neighbourhood::default();
        around.origin_m = [15.0, 3.0];
        for i in 0..count {
            let f =
                |k: f64, m: f64| ((i as f64 * k).sin() * 43758.5453).rem_euclid(1.0) * m - m / 2.0;
            around.x_m.push(f(12.9898, 9.0) as f32);
            around.y_m.push(f(78.233, 9.0) as f32);
            around.z_m.push(f(37.719, 2.0) as f32);
            around.height_m.push(1.0);
            around.index.push(i as u32);
            around.is_known.push(false);
        }
        around
    }

    /// Joins pair by pair.
    fn plain(around: &Neighbourhood, seed: usize, join_m: f32) -> Vec<u32> {
        let near = |a: usize, b: usize, d: f32| {
            let (dx, dy) = (around.x_m[a] - around.x_m[b], around.y_m[a] - around.y_m[b]);
            dx * dx + dy * dy <= d * d
        };
        let mut members = vec![seed as u32];
        let mut next = 0;
        while next < members.len() {
            let t = members[next] as usize;
            next += 1;
            for s in 0..around.len() {
                if near(s, t, join_m) && !members.contains(&(s as u32)) {
                    members.push(s as u32);
                }
            }
        }
        members.sort_unstable();
        members
    }

    #[test]
    fn equals_joining_point_by_point() {
        let mut partial = 0;
        for count in [1, 2, 60, 150, 250, 400] {
            let around = scattered(count);
            let mut distance = Distance::new(&DistanceSettings::default());
            for seed in [0, count / 2, count - 1] {
                let bounds = Bounds {
                    height_min_m: 0.2,
                    scale: 0.8,
                };
                let join = (distance.join_distance_m(around.range_m(seed)) * 0.8) as f32;
                let mut members = Vec::new();
                distance.grow(&around, seed, &bounds, &mut members);
                members.sort_unstable();
                assert_eq!(members, plain(&around, seed, join), "{count} {seed}");
                partial += usize::from(members.len() > 3 && members.len() < count / 2);
            }
        }
        assert!(partial > 0, "no case between alone and everything");
    }

    #[test]
    fn the_rest_comes_in_the_parts_that_growing_alone_gives() {
        let bounds = Bounds {
            height_min_m: 0.2,
            scale: 0.6,
        };
        for count in [1, 60, 250, 900] {
            let around = scattered(count);
            let mut distance = Distance::new(&DistanceSettings::default());
            let mut members = Vec::new();
            let mut is_taken = vec![false; count];
            is_taken[count / 2] = count > 1;
            let mut expected = Vec::new();
            let mut is_left: Vec<bool> = is_taken.iter().map(|taken| !taken).collect();
            while let Some(seed) = is_left.iter().position(|&left| left) {
                distance.grow(&around, seed, &bounds, &mut members);
                members.iter().for_each(|&m| is_left[m as usize] = false);
                members.sort_unstable();
                expected.push(members.clone());
            }
            let mut found = Vec::new();
            distance.grow_rest(&around, &bounds, &mut is_taken, &mut members, &mut |part| {
                let mut part = part.to_vec();
                part.sort_unstable();
                found.push(part);
            });
            assert_eq!(found, expected);
            assert!(is_taken.iter().all(|&taken| taken));
        }
    }
}
