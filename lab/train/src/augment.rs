//! Augmentation: pasted objects, mirroring, rotation, scaling (the public SECOND configuration).
//!
//! A pasted object keeps its range and bearing, so that its points keep the sensor's pattern; it is moved to the height of the
//! ground at its new place. It is rejected where it would overlap another object or an obstacle.

use crate::scan::{LabelledObject, LabelledScan};
use crate::{database::Database, database::Sample, synthetic_unknown::make_up};
use mluc_geometry::{Box3, Inside, Random, intersection_bev_m2, limit_period};
use mluc_model::Grid;
use std::f64::consts::{FRAC_PI_4, PI, TAU};
use std::sync::Arc;

const TURN_MAX_RAD: f64 = FRAC_PI_4;
const SCALE: [f64; 2] = [0.95, 1.05];
/// Radius around a pasted object in which the ground is estimated.
const GROUND_RADIUS_M: f32 = 2.0;
/// With fewer points there is no ground estimate; the object then keeps its own height.
const GROUND_POINTS_MIN: usize = 8;
/// Points up to this far above the lowest ones count as ground.
const GROUND_THICKNESS_M: f32 = 0.25;
/// Maximum vertical shift of a pasted object.
const GROUND_SHIFT_MAX_M: f64 = 1.0;
/// Maximum number of scan points above the ground inside the box; with more, the place is occupied.
const OBSTACLE_POINTS_MAX: usize = 10;
/// Obstacle points start this far above the bottom of the box.
const OBSTACLE_HEIGHT_M: f64 = 0.3;

/// Settings of the augmentation.
#[derive(Clone, Debug)]
pub struct Augmentation {
    /// Objects to paste.
    pub database: Arc<Database>,
    /// Wanted number of objects of each class after pasting.
    pub wanted: Vec<usize>,
    /// Number of synthetic unknown objects per frame.
    pub synthetic_unknown: usize,
    /// Mean l, w, h of the known classes, m: synthetic unknown objects have other sizes.
    pub classes_m: Vec<[f64; 3]>,
    /// Also mirror front to back (for a full-circle scan).
    pub mirror_x: bool,
}

impl Augmentation {
    /// Augments a scan in place.
    pub fn apply(&self, scan: &mut LabelledScan, random: &mut Random) {
        self.paste(scan, random);
        if random.coin() {
            mirror(scan, 1);
        }
        if self.mirror_x && random.coin() {
            mirror(scan, 0);
        }
        turn(scan, random.uniform(-TURN_MAX_RAD, TURN_MAX_RAD));
        scale(scan, random.uniform(SCALE[0], SCALE[1]));
    }

    fn paste(&self, scan: &mut LabelledScan, random: &mut Random) {
        let mut pasted: Vec<Sample> = vec![];
        let lists = self.database.iter().zip(&self.wanted).enumerate();
        for (class, (samples, wanted)) in lists.filter(|(_, (samples, _))| !samples.is_empty()) {
            let same = scan.objects.iter().filter(|o| o.class == Some(class));
            for _ in same.count()..*wanted {
                let sample = &samples[random.below(samples.len())];
                pasted.extend(place(sample, scan, &pasted));
            }
        }
        for _ in 0..self.synthetic_unknown {
            let sample = make_up(&self.database, &self.classes_m, random);
            let placed = sample.and_then(|sample| place(&sample, scan, &pasted));
            pasted.extend(placed);
        }
        let taken: Vec<Inside> = pasted.iter().map(|s| Inside::of(&s.bounds, 0.0)).collect();
        let is_free = |p: &[f32; 4]| !taken.iter().any(|own| own.has_point(p));
        scan.points.retain(is_free);
        let mut points: Vec<[f32; 4]> = vec![];
        for sample in pasted {
            let count = sample.points.len();
            let object = LabelledObject::new(sample.class, sample.bounds, count);
            scan.objects.push(object);
            points.extend(sample.points);
        }
        // Pasted points come first: where a voxel or the frame is full, later points are dropped.
        points.append(&mut scan.points);
        scan.points = points;
    }
}

/// The sample at the ground height of its place; `None` where the place is occupied.
fn place(sample: &Sample, scan: &LabelledScan, pasted: &[Sample]) -> Option<Sample> {
    let bounds = &sample.bounds;
    let is_free = |other: &Box3| {
        let [dx, dy] = [0, 1].map(|i| other.center_m[i] - bounds.center_m[i]);
        let apart_m = other.half_diagonal_m() + bounds.half_diagonal_m();
        dx.hypot(dy) >= apart_m || intersection_bev_m2(other, bounds) <= 0.0
    };
    let objects = scan.objects.iter().map(|o| &o.bounds);
    if !objects.chain(pasted.iter().map(|s| &s.bounds)).all(is_free) {
        return None;
    }
    let [x, y, z] = bounds.center_m;
    let reach = GROUND_RADIUS_M.max(bounds.half_diagonal_m() as f32);
    let is_near =
        |p: &&[f32; 4]| (p[0] - x as f32).abs() < reach && (p[1] - y as f32).abs() < reach;
    let near: Vec<&[f32; 4]> = scan.points.iter().filter(is_near).collect();
    let bottom = z - bounds.size_m[2] / 2.0;
    let shift = ground(&near).map_or(0.0, |ground| ground - bottom);
    if shift.abs() > GROUND_SHIFT_MAX_M {
        return None;
    }
    let mut placed = sample.clone();
    placed.bounds.center_m[2] += shift;
    placed.points.iter_mut().for_each(|p| p[2] += shift as f32);
    let own = Inside::of(&placed.bounds, 0.0);
    let low = (bottom + shift + OBSTACLE_HEIGHT_M) as f32;
    let obstacles = near.iter().filter(|p| p[2] > low && own.has_point(p));
    (obstacles.count() <= OBSTACLE_POINTS_MAX).then_some(placed)
}

/// Mean height of the lowest points.
fn ground(near: &[&[f32; 4]]) -> Option<f64> {
    if near.len() < GROUND_POINTS_MIN {
        return None;
    }
    let mut heights: Vec<f32> = near.iter().map(|p| p[2]).collect();
    let rank = heights.len() / 20;
    let (_, low, _) = heights.select_nth_unstable_by(rank, f32::total_cmp);
    let limit = *low + GROUND_THICKNESS_M;
    heights.retain(|z| *z <= limit);
    let sum: f64 = heights.iter().map(|z| f64::from(*z)).sum();
    Some(sum / heights.len() as f64)
}

/// Axis 0: x to -x; axis 1: y to -y.
fn mirror(scan: &mut LabelledScan, axis: usize) {
    scan.points.iter_mut().for_each(|p| p[axis] = -p[axis]);
    for object in &mut scan.objects {
        let b = &mut object.bounds;
        b.center_m[axis] = -b.center_m[axis];
        let offset_rad = if axis == 0 { PI } else { 0.0 };
        b.yaw_rad = limit_period(offset_rad - b.yaw_rad, 0.5, TAU);
    }
}

fn turn(scan: &mut LabelledScan, angle_rad: f64) {
    let (sin, cos) = angle_rad.sin_cos();
    let (s, c) = (sin as f32, cos as f32);
    for p in &mut scan.points {
        (p[0], p[1]) = (p[0] * c - p[1] * s, p[0] * s + p[1] * c);
    }
    for object in &mut scan.objects {
        let b = &mut object.bounds;
        let [x, y, _] = b.center_m;
        (b.center_m[0], b.center_m[1]) = (x * cos - y * sin, x * sin + y * cos);
        b.yaw_rad = limit_period(b.yaw_rad + angle_rad, 0.5, TAU);
    }
}

fn scale(scan: &mut LabelledScan, factor: f64) {
    let f = factor as f32;
    for p in &mut scan.points {
        p[..3].iter_mut().for_each(|v| *v *= f);
    }
    for object in &mut scan.objects {
        object.bounds.center_m = object.bounds.center_m.map(|v| v * factor);
        object.bounds.size_m = object.bounds.size_m.map(|v| v * factor);
    }
}

/// Drops points out of range, and objects without a corner in range; counts the objects' points anew.
pub fn crop(scan: &mut LabelledScan, grid: &Grid) {
    let ranges = [0, 1].map(|i| {
        let [low, high] = [grid.range_min_m[i], grid.range_max_m[i]].map(f64::from);
        low..=high
    });
    let is_inside = |c: &[f64; 2]| (0..2).all(|i| ranges[i].contains(&c[i]));
    scan.points.retain(|p| is_inside(&[p[0].into(), p[1].into()]));
    let has_corner = |o: &LabelledObject| o.bounds.footprint_m().iter().any(is_inside);
    scan.objects.retain(has_corner);
    scan.count_points();
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A scan with flat ground at -1.7 m and a car of 300 points.
    fn scan() -> LabelledScan {
        let mut random = Random::new(2, &[]);
        let mut ground = || {
            let [x, y] = [0, 1].map(|_| random.uniform(-30.0, 30.0) as f32);
            [x, y, -1.7 + 0.01 * random.normal() as f32, 0.0]
        };
        let mut points: Vec<[f32; 4]> = (0..40_000).map(|_| ground()).collect();
        points.extend((0..300).map(|_| {
            let half = [1.0, 0.4, 0.7];
            let [dx, dy, dz] = half.map(|half| random.uniform(-half, half) as f32);
            [10.0 + dx, 4.0 + dy, -0.9 + dz, 0.0]
        }));
        let bounds = Box3::new([10.0, 4.0, -0.9, 4.0, 1.8, 1.6, 0.4]);
        let objects = vec![LabelledObject::new(Some(0), bounds, 0)];
        let mut scan = LabelledScan { points, objects };
        scan.count_points();
        scan
    }

    fn augmentation() -> Augmentation {
        let sample = |i: i32| {
            // From a frame whose ground is 0.5 m lower.
            let (x, y) = (-20.0 + 2.0 * f64::from(i), -8.0 + f64::from(i % 3));
            Sample {
                class: Some(1),
                bounds: Box3::new([x, y, -1.35, 1.0, 0.7, 1.7, 1.0]),
                points: vec![[x as f32, y as f32, -1.35, 0.0]; 9],
            }
        };
        Augmentation {
            database: Arc::new(vec![vec![], (0..20).map(sample).collect()]),
            wanted: vec![0, 6],
            synthetic_unknown: 0,
            classes_m: vec![],
            mirror_x: true,
        }
    }

    #[test]
    fn points_stay_in_their_boxes_through_every_step() {
        let before = scan().objects[0].points;
        let counts = |s: &LabelledScan| s.objects.iter().map(|o| o.points).collect::<Vec<_>>();
        for seed in 0..20 {
            let mut varied = scan();
            augmentation().apply(&mut varied, &mut Random::new(seed, &[]));
            let noted = counts(&varied);
            varied.count_points();
            let counted = counts(&varied);
            assert_eq!(counted[0], before);
            // After the scan's points in a pasted box are removed, only its own points are left.
            assert_eq!(noted[1..], counted[1..]);
            assert!(varied.objects.len() > 3);
        }
    }

    #[test]
    fn pasted_objects_stand_on_the_ground_and_touch_nothing() {
        let mut scan = scan();
        augmentation().paste(&mut scan, &mut Random::new(1, &[]));
        for (i, a) in scan.objects.iter().enumerate().skip(1) {
            let bottom = a.bounds.center_m[2] - a.bounds.size_m[2] / 2.0;
            assert!((bottom + 1.7).abs() < 0.05, "{bottom}");
            for b in &scan.objects[..i] {
                assert_eq!(intersection_bev_m2(&a.bounds, &b.bounds), 0.0);
            }
        }
    }

    #[test]
    fn an_object_is_refused_where_something_stands() {
        let mut scan = scan();
        let sample = augmentation().database[1][3].clone();
        assert!(place(&sample, &scan, &[]).is_some());
        let [x, y, _] = sample.bounds.center_m.map(|v| v as f32);
        let wall = (0..40).map(|i| [x, y, -1.3 + 0.02 * i as f32, 0.0]);
        scan.points.extend(wall);
        assert!(place(&sample, &scan, &[]).is_none());
    }
}
