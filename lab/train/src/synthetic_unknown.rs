//! Synthetic unknown objects, made of known objects: no label of an unknown class is used.
//!
//! A known object is scaled axis by axis, or the rear (the lower part) of one is joined to the front (the upper part) of another. A slab of points may be
//! cut out, like windows and open sides. Objects that still have the size of a known class are rejected. The result moves along its bearing by the
//! mean factor, so that its points are as dense as a scan's. Extension of the paper; after the resizing of Koesel et al. (IV 2024) and Cen et al. (ECCV 2022).

use crate::database::{Database, Sample};
use mluc_geometry::{Box3, Random};
use mluc_simulate::synthetic_unknown::{
    CUT_CHANCE, CUT_LOW, CUT_SHARE, JOIN_CHANCE, ON_ROADS, has_known_size, has_road_size,
};

/// Maximum difference of the viewing angles of two objects that are joined.
const ANGLE_MAX_RAD: f64 = 0.5;
/// Number of draws for a partner, and for an object.
const DRAWS: usize = 12;
/// Minimum number of points of an object.
const POINTS_MIN: usize = 8;

/// An object in its own frame: origin at the middle of its bottom, x along its heading.
struct Local {
    size_m: [f64; 3],
    points: Vec<[f64; 4]>,
}

impl Local {
    fn of(sample: &Sample) -> Local {
        let b = &sample.bounds;
        let (sin, cos) = b.yaw_rad.sin_cos();
        let bottom = b.center_m[2] - b.size_m[2] / 2.0;
        let local = |p: &[f32; 4]| {
            let [x, y, z, intensity] = p.map(f64::from);
            let (dx, dy) = (x - b.center_m[0], y - b.center_m[1]);
            let (u, v) = (dx * cos + dy * sin, dy * cos - dx * sin);
            [u, v, z - bottom, intensity]
        };
        Local { size_m: b.size_m, points: sample.points.iter().map(local).collect() }
    }

    fn scale(&mut self, factors: [f64; 3]) {
        for (axis, factor) in factors.into_iter().enumerate() {
            self.size_m[axis] *= factor;
            self.points.iter_mut().for_each(|p| p[axis] *= factor);
        }
    }

    /// The part of this object below the middle of `axis` (0: the rear, 2: the lower half), with the part of the other above it.
    fn join(self, mut other: Local, axis: usize) -> Local {
        // The other object is scaled to this one's width, and to its length or height at the joint.
        let mut fit = [0, 1, 2].map(|i| self.size_m[i] / other.size_m[i]);
        fit[axis] = 1.0;
        other.scale(fit);
        let middle = |part: &Local| if axis == 2 { part.size_m[2] / 2.0 } else { 0.0 };
        let (low, high) = (middle(&self), middle(&other));
        let mut size_m = self.size_m;
        size_m[axis] = (self.size_m[axis] + other.size_m[axis]) / 2.0;
        // Along x the joint moves from the middle by a quarter of the difference of the lengths.
        let off = (self.size_m[0] - other.size_m[0]) / 4.0;
        let shift = if axis == 2 { 0.0 } else { off };
        let mut points: Vec<[f64; 4]> = self.points;
        points.retain(|p| p[axis] < low);
        let upper = other.points.into_iter().filter(|p| p[axis] >= high);
        points.extend(upper.map(|mut p| {
            p[axis] += low - high;
            p
        }));
        points.iter_mut().for_each(|p| p[0] += shift);
        Local { size_m, points }
    }

    /// Removes the points of a horizontal slab.
    fn cut(&mut self, random: &mut Random) {
        let share = random.uniform(CUT_SHARE[0], CUT_SHARE[1]);
        let low = random.uniform(CUT_LOW, 1.0 - share - 0.1) * self.size_m[2];
        let high = low + share * self.size_m[2];
        self.points.retain(|p| p[2] < low || p[2] > high);
    }

    /// The object in the sensor frame, with the heading of `like` and `factor` times as far away.
    fn place(self, like: &Box3, factor: f64) -> Sample {
        let (sin, cos) = like.yaw_rad.sin_cos();
        let [x, y, _] = like.center_m.map(|v| v * factor);
        let bottom = like.center_m[2] - like.size_m[2] / 2.0;
        let out = |[u, v, h, intensity]: [f64; 4]| {
            let (dx, dy) = (x + u * cos - v * sin, y + u * sin + v * cos);
            [dx, dy, bottom + h, intensity].map(|v| v as f32)
        };
        Sample {
            class: None,
            bounds: Box3 {
                center_m: [x, y, bottom + self.size_m[2] / 2.0],
                size_m: self.size_m,
                yaw_rad: like.yaw_rad,
            },
            points: self.points.into_iter().map(out).collect(),
        }
    }
}

/// Makes one object; `None` where a dozen draws gave none. `classes_m`: mean l, w, h of the known classes.
pub fn make_up(database: &Database, classes_m: &[[f64; 3]], random: &mut Random) -> Option<Sample> {
    (0..DRAWS).find_map(|_| attempt(database, classes_m, random))
}

fn draw<'a>(database: &'a Database, random: &mut Random) -> Option<&'a Sample> {
    let lists: Vec<_> = database.iter().filter(|list| !list.is_empty()).collect();
    let list = lists.get(random.below(lists.len().max(1)))?;
    list.get(random.below(list.len()))
}

fn attempt(database: &Database, classes_m: &[[f64; 3]], random: &mut Random) -> Option<Sample> {
    let sample = draw(database, random)?;
    let mut local = Local::of(sample);
    let factor = |[low, high]: [f64; 2]| random.uniform(low.ln(), high.ln()).exp();
    let mut factors = ON_ROADS.factors.map(factor);
    if random.uniform(0.0, 1.0) < JOIN_CHANCE {
        let partner =
            (0..DRAWS).find_map(|_| draw(database, random).filter(|p| alike_views(sample, p)))?;
        let axis = if random.coin() { 0 } else { 2 };
        local = local.join(Local::of(partner), axis);
        // A join is already new: it is scaled less.
        factors = factors.map(f64::sqrt);
    }
    local.scale(factors);
    if random.uniform(0.0, 1.0) < CUT_CHANCE {
        local.cut(random);
    }
    let size_m = local.size_m;
    let fits = has_road_size(size_m, &ON_ROADS) && !has_known_size(size_m, classes_m);
    if !fits || local.points.len() < POINTS_MIN {
        return None;
    }
    let sides = (factors[0] * factors[1]).sqrt();
    let mean = sides.mul_add(0.5, 0.5 * factors[2]);
    Some(local.place(&sample.bounds, mean.clamp(0.6, 1.6)))
}

/// Whether the sensor sees the same sides of two objects.
fn alike_views(a: &Sample, b: &Sample) -> bool {
    let view = |s: &Sample| s.bounds.yaw_rad - s.bounds.center_m[1].atan2(s.bounds.center_m[0]);
    let difference = view(a) - view(b);
    difference.sin().abs() < ANGLE_MAX_RAD.sin() && difference.cos() > 0.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use mluc_geometry::Inside;

    const CLASSES_M: [[f64; 3]; 2] = [[4.2, 1.8, 1.6], [0.8, 0.6, 1.7]];

    fn database() -> Database {
        let mut random = Random::new(5, &[]);
        let mut sample = |class: usize| {
            let [x, y] = [random.uniform(5.0, 30.0), random.uniform(-20.0, 20.0)];
            let [l, w, h] = CLASSES_M[class];
            let yaw_rad = random.uniform(-3.0, 3.0);
            let bounds = Box3::new([x, y, -0.8, l, w, h, yaw_rad]);
            let mut point = || {
                let [u, v, up] = [l, w, h].map(|size| random.uniform(-size / 2.0, size / 2.0));
                [u, v, up + h / 2.0, 0.5]
            };
            let local = Local { size_m: [l, w, h], points: (0..200).map(|_| point()).collect() };
            Sample { class: Some(class), ..local.place(&bounds, 1.0) }
        };
        let samples = |class| (0..20).map(|_| sample(class)).collect();
        [0, 1].map(samples).into()
    }

    #[test]
    fn synthetic_unknown_objects_hold_their_points_and_have_no_known_size() {
        let (database, mut random) = (database(), Random::new(1, &[]));
        let mut lengths = vec![];
        for _ in 0..200 {
            let made = make_up(&database, &CLASSES_M, &mut random).expect("one of a dozen draws");
            assert_eq!(made.class, None);
            let grown = Inside::of(&made.bounds, 5e-4);
            assert!(made.points.iter().all(|p| grown.has_point(p)), "{:?}", made.bounds);
            let size_m = made.bounds.size_m;
            assert!(!has_known_size(size_m, &CLASSES_M), "{size_m:?}");
            lengths.push(made.bounds.size_m[0]);
        }
        let most = lengths.iter().copied().fold(0.0, f64::max);
        let least = lengths.iter().copied().fold(f64::MAX, f64::min);
        assert!(least < 0.6 && most > 7.0, "lengths {least} to {most} m");
    }

    #[test]
    fn a_cut_takes_a_slab_and_the_same_seed_makes_the_same_object() {
        let database = database();
        let mut local = Local::of(&database[0][0]);
        let before = local.points.len();
        local.cut(&mut Random::new(3, &[]));
        assert!((before / 3..before * 9 / 10).contains(&local.points.len()));
        let make = || make_up(&database, &CLASSES_M, &mut Random::new(8, &[4]));
        assert_eq!(make(), make());
    }
}
