//! Other frames from the same data: paste objects, mirror, turn, scale (the public SECOND configuration).
//!
//! A pasted object keeps its range and bearing, so that its pattern of points stays the sensor's; it is put on the
//! ground of its new place. It is turned down where it would touch another object or stand in a wall.

use mluc_geometry::{Box3, intersection_bev_m2, limit_period};
use mluc_model::Grid;

use super::database::{Database, Sample};
use super::made_up::make_up;
use super::random::Random;
use super::scene::{InBox, Object, Scene};

const TURN_MAX_RAD: f64 = std::f64::consts::FRAC_PI_4;
const SCALE: [f64; 2] = [0.95, 1.05];
/// Ground is looked for this far around a pasted object.
const GROUND_RADIUS_M: f32 = 2.0;
/// Fewer points tell no ground; the object then keeps its own height.
const GROUND_POINTS_MIN: usize = 8;
/// Points this far above the lowest ones still are ground.
const GROUND_THICKNESS_M: f32 = 0.25;
/// An object is not moved further up or down.
const GROUND_SHIFT_MAX_M: f64 = 1.0;
/// More points of the scene than this above the ground inside the box: something stands there.
const OBSTACLE_POINTS_MAX: usize = 10;
/// Obstacle points start this far above the bottom of the box.
const OBSTACLE_HEIGHT_M: f64 = 0.3;

/// How frames are varied.
#[derive(Clone, Debug)]
pub struct Augmentation {
    /// Objects to paste.
    pub database: Database,
    /// Objects of each class after pasting.
    pub wanted: Vec<usize>,
    /// Objects made up to stand for the unknown, a frame.
    pub made_up: usize,
    /// Mean l, w, h of the known classes, m: made-up objects have other sizes.
    pub classes_m: Vec<[f64; 3]>,
    /// Also mirror front to back (a scan all around).
    pub mirror_x: bool,
}

impl Augmentation {
    /// Varies a scene in place.
    pub fn apply(&self, scene: &mut Scene, random: &mut Random) {
        self.paste(scene, random);
        if random.coin() {
            mirror(scene, 1);
        }
        if self.mirror_x && random.coin() {
            mirror(scene, 0);
        }
        turn(scene, random.uniform(-TURN_MAX_RAD, TURN_MAX_RAD));
        scale(scene, random.uniform(SCALE[0], SCALE[1]));
    }

    fn paste(&self, scene: &mut Scene, random: &mut Random) {
        let mut pasted: Vec<Sample> = vec![];
        for (class, wanted) in self.wanted.iter().enumerate() {
            let Some(samples) = self.database.samples.get(class).filter(|s| !s.is_empty()) else {
                continue;
            };
            let present = scene
                .objects
                .iter()
                .filter(|o| o.class == Some(class))
                .count();
            for _ in present..*wanted {
                let sample = &samples[random.below(samples.len())];
                if let Some(sample) = place(sample, scene, &pasted) {
                    pasted.push(sample);
                }
            }
        }
        for _ in 0..self.made_up {
            let sample = make_up(&self.database, &self.classes_m, random);
            let placed = sample.and_then(|sample| place(&sample, scene, &pasted));
            pasted.extend(placed);
        }
        let tests: Vec<InBox> = pasted.iter().map(|s| InBox::new(&s.bounds)).collect();
        scene
            .points
            .retain(|p| !tests.iter().any(|t| t.contains(p)));
        let mut points: Vec<[f32; 4]> = vec![];
        for sample in pasted {
            let count = sample.points.len();
            points.extend(sample.points);
            scene.objects.push(Object {
                class: sample.class,
                made_up: sample.class.is_none(),
                bounds: sample.bounds,
                points: count,
            });
        }
        // In front: where a voxel or the frame is full, later points are left out.
        points.append(&mut scene.points);
        scene.points = points;
    }
}

/// The sample on the ground of its place; `None` where the place is taken.
fn place(sample: &Sample, scene: &Scene, pasted: &[Sample]) -> Option<Sample> {
    let taken = |other: &Box3| {
        let reach = |b: &Box3| b.size_m[0].hypot(b.size_m[1]) / 2.0;
        let [dx, dy] = [0, 1].map(|i| other.center_m[i] - sample.bounds.center_m[i]);
        dx.hypot(dy) < reach(other) + reach(&sample.bounds)
            && intersection_bev_m2(other, &sample.bounds) > 0.0
    };
    if scene.objects.iter().any(|o| taken(&o.bounds)) || pasted.iter().any(|s| taken(&s.bounds)) {
        return None;
    }
    let [x, y, z] = sample.bounds.center_m;
    let reach =
        GROUND_RADIUS_M.max((sample.bounds.size_m[0].hypot(sample.bounds.size_m[1]) / 2.0) as f32);
    let near: Vec<&[f32; 4]> = scene
        .points
        .iter()
        .filter(|p| (p[0] - x as f32).abs() < reach && (p[1] - y as f32).abs() < reach)
        .collect();
    let bottom = z - sample.bounds.size_m[2] / 2.0;
    let shift = ground(&near).map_or(0.0, |ground| ground - bottom);
    if shift.abs() > GROUND_SHIFT_MAX_M {
        return None;
    }
    let mut placed = sample.clone();
    placed.bounds.center_m[2] += shift;
    placed.points.iter_mut().for_each(|p| p[2] += shift as f32);
    let test = InBox::new(&placed.bounds);
    let low = (bottom + shift + OBSTACLE_HEIGHT_M) as f32;
    let obstacles = near
        .iter()
        .filter(|p| p[2] > low && test.contains(p))
        .count();
    (obstacles <= OBSTACLE_POINTS_MAX).then_some(placed)
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
    let ground: Vec<f64> = heights
        .iter()
        .filter(|z| **z <= limit)
        .map(|z| f64::from(*z))
        .collect();
    Some(ground.iter().sum::<f64>() / ground.len().max(1) as f64)
}

/// Along axis 0: x to -x; along axis 1: y to -y.
fn mirror(scene: &mut Scene, axis: usize) {
    scene.points.iter_mut().for_each(|p| p[axis] = -p[axis]);
    for object in &mut scene.objects {
        let b = &mut object.bounds;
        b.center_m[axis] = -b.center_m[axis];
        b.yaw_rad = if axis == 0 {
            std::f64::consts::PI - b.yaw_rad
        } else {
            -b.yaw_rad
        };
        b.yaw_rad = limit_period(b.yaw_rad, 0.5, std::f64::consts::TAU);
    }
}

fn turn(scene: &mut Scene, angle_rad: f64) {
    let (sin, cos) = angle_rad.sin_cos();
    let (s, c) = (sin as f32, cos as f32);
    for p in &mut scene.points {
        (p[0], p[1]) = (p[0] * c - p[1] * s, p[0] * s + p[1] * c);
    }
    for object in &mut scene.objects {
        let b = &mut object.bounds;
        let [x, y, _] = b.center_m;
        (b.center_m[0], b.center_m[1]) = (x * cos - y * sin, x * sin + y * cos);
        b.yaw_rad = limit_period(b.yaw_rad + angle_rad, 0.5, std::f64::consts::TAU);
    }
}

fn scale(scene: &mut Scene, factor: f64) {
    let f = factor as f32;
    scene
        .points
        .iter_mut()
        .for_each(|p| (p[0], p[1], p[2]) = (p[0] * f, p[1] * f, p[2] * f));
    for object in &mut scene.objects {
        object.bounds.center_m = object.bounds.center_m.map(|v| v * factor);
        object.bounds.size_m = object.bounds.size_m.map(|v| v * factor);
    }
}

/// Drops objects with no corner in range.
pub fn crop(scene: &mut Scene, grid: &Grid) {
    scene.objects.retain(|object| {
        object.bounds.footprint_m().iter().any(|corner| {
            (0..2).all(|i| {
                corner[i] >= f64::from(grid.range_min_m[i])
                    && corner[i] <= f64::from(grid.range_max_m[i])
            })
        })
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scene() -> Scene {
        let mut random = Random::new(2, &[]);
        let mut points: Vec<[f32; 4]> = (0..40_000)
            .map(|_| {
                let at = [random.uniform(-30.0, 30.0), random.uniform(-30.0, 30.0)];
                [
                    at[0] as f32,
                    at[1] as f32,
                    -1.7 + 0.01 * random.normal() as f32,
                    0.0,
                ]
            })
            .collect();
        let bounds = Box3::new([10.0, 4.0, -0.9, 4.0, 1.8, 1.6, 0.4]);
        for _ in 0..300 {
            let d = [
                random.uniform(-1.0, 1.0),
                random.uniform(-0.4, 0.4),
                random.uniform(-0.7, 0.7),
            ];
            points.push([
                10.0 + d[0] as f32,
                4.0 + d[1] as f32,
                -0.9 + d[2] as f32,
                0.0,
            ]);
        }
        let mut scene = Scene {
            points,
            objects: vec![Object {
                class: Some(0),
                bounds,
                points: 0,
                made_up: false,
            }],
        };
        scene.count_points();
        scene
    }

    fn augmentation() -> Augmentation {
        let mut samples = vec![];
        for i in 0..20 {
            // From a frame whose ground lies 0.5 m lower.
            let bounds = Box3::new([
                -20.0 + 2.0 * f64::from(i),
                -8.0 + f64::from(i % 3),
                -1.35,
                1.0,
                0.7,
                1.7,
                1.0,
            ]);
            let [x, y, z] = bounds.center_m.map(|v| v as f32);
            samples.push(Sample {
                class: Some(1),
                bounds,
                points: vec![[x, y, z, 0.0]; 9],
            });
        }
        Augmentation {
            database: Database {
                samples: vec![vec![], samples],
            },
            wanted: vec![0, 6],
            made_up: 0,
            classes_m: vec![],
            mirror_x: true,
        }
    }

    #[test]
    fn points_stay_in_their_boxes_through_every_step() {
        let before = scene().objects[0].points;
        for seed in 0..20 {
            let mut varied = scene();
            augmentation().apply(&mut varied, &mut Random::new(seed, &[]));
            let noted: Vec<usize> = varied.objects.iter().map(|o| o.points).collect();
            varied.count_points();
            let counted: Vec<usize> = varied.objects.iter().map(|o| o.points).collect();
            assert_eq!(counted[0], before);
            // Removing the scene's points from a pasted box leaves its own.
            assert_eq!(noted[1..], counted[1..]);
            assert!(varied.objects.len() > 3);
        }
    }

    #[test]
    fn pasted_objects_stand_on_the_ground_and_touch_nothing() {
        let mut scene = scene();
        augmentation().paste(&mut scene, &mut Random::new(1, &[]));
        for (i, a) in scene.objects.iter().enumerate().skip(1) {
            let bottom = a.bounds.center_m[2] - a.bounds.size_m[2] / 2.0;
            assert!((bottom + 1.7).abs() < 0.05, "{bottom}");
            for b in &scene.objects[..i] {
                assert_eq!(intersection_bev_m2(&a.bounds, &b.bounds), 0.0);
            }
        }
    }

    #[test]
    fn an_obstacle_turns_an_object_down() {
        let mut scene = scene();
        let sample = augmentation().database.samples[1][3].clone();
        assert!(place(&sample, &scene, &[]).is_some());
        let [x, y, _] = sample.bounds.center_m.map(|v| v as f32);
        scene
            .points
            .extend((0..40).map(|i| [x, y, -1.3 + 0.02 * i as f32, 0.0]));
        assert!(place(&sample, &scene, &[]).is_none());
    }
}
