//! Positions of the labelled objects of a scene.
//!
//! The range of each object is drawn first, from the range distribution of KITTI's labels of its class. The position across the road follows from the
//! usual places of such objects (lanes, kerb, parking lots, pavements), and the position along the road from both. Objects never overlap.

pub(crate) mod places;

use super::objects::{Habit, Model, build, mean_size_m};
use super::synthetic_unknown::{has_known_size, is_large};
use super::{Class, ExportOptions, Family, Split, Unseen, footprint::Footprint, ground::Ground};
use super::{place::Place, random::Dice};
use std::f32::consts::{FRAC_PI_2, PI, TAU};

/// An object in the scene: its model, and its footprint in the sensor frame.
pub(crate) struct Placed {
    pub(crate) class: Class,
    pub(crate) model: Model,
    pub(crate) footprint: Footprint,
}

/// Everything that takes ground, and the labelled objects among it.
pub(crate) struct Layout<'a> {
    pub(crate) options: &'a ExportOptions,
    pub(crate) ground: &'a Ground,
    pub(crate) taken: Vec<Footprint>,
    pub(crate) placed: Vec<Placed>,
}

/// x, y (m) and heading (rad) in the sensor frame.
type Pose = (f32, f32, f32);

/// Maximum number of synthetic unknown objects in a frame: many more than real unknown objects, so that each frame teaches more.
const SYNTHETIC_UNKNOWN_MAX: usize = 4;
/// Mean number of objects per frame of each class that is known in addition to the family's classes.
const ALSO_KNOWN: f32 = 2.0;
/// Chance that a car of `sim-any` drives in the sensor's lane.
const OWN_LANE_CHANCE: f32 = 0.15;
/// Chance that a car of `sim-any`'s training scans is in a row of parking bays at the kerb.
const KERB_BAY_CHANCE: f32 = 0.2;
const ATTEMPTS: usize = 48;
const ATTEMPTS_PER_RANGE: usize = 16;

/// Places the objects of one frame around the sensor's own vehicle; unknown classes only where the split allows them.
pub(crate) fn place_objects<'a>(
    options: &'a ExportOptions,
    ground: &'a Ground,
    own: Footprint,
    dice: &mut Dice,
) -> Layout<'a> {
    let (family, split) = (options.family, options.split);
    let mut layout = Layout { options, ground, taken: vec![own], placed: Vec::new() };
    let (count, weights) = match family {
        Family::SimUdi => (dice.whole(9, 20), [0.53, 0.21, 0.11, 0.15]),
        Family::SimKitti => (dice.whole(6, 15), [0.58, 0.24, 0.18, 0.0]),
        Family::SimAny => places::known(ground.place, dice),
    };
    let mut wanted = Vec::new();
    if split != Split::Train {
        let unknown = match ground.place {
            _ if options.unseen => Unseen::of(split).map(Class::Unseen).collect(),
            Place::Hall => vec![Class::Forklift, Class::GolfCart],
            _ => family.unknown_classes().to_vec(),
        };
        wanted.extend((0..dice.events(0.6)).map(|_| unknown[dice.whole(0, unknown.len() - 1)]));
    }
    if options.synthetic_unknown {
        let count = dice.whole(1, SYNTHETIC_UNKNOWN_MAX);
        wanted.extend(std::iter::repeat_n(Class::SyntheticUnknown, count));
    }
    for class in options.also_known() {
        wanted.extend((0..dice.events(ALSO_KNOWN)).map(|_| class));
    }
    let knowns = [Class::Car, Class::Pedestrian, Class::Cyclist, Class::Truck];
    wanted.extend((0..count).map(|_| knowns[dice.weighted(&weights)]));
    // Long and rare objects first: later there is no room for them.
    wanted.sort_by_key(|class| match class {
        Class::Truck => 0,
        Class::Cyclist | Class::Pedestrian => 2,
        Class::Car => 3,
        _ => 1,
    });
    let mut index = 0;
    while index < wanted.len() {
        let class = wanted[index];
        let same = wanted[index..].iter().take_while(|c| **c == class).count();
        index += layout.place_some(class, same, dice).max(1);
    }
    layout
}

impl Layout<'_> {
    fn model(&self, class: Class, dice: &mut Dice) -> Model {
        let family = self.options.family;
        let mut model = build(class, family, dice);
        if class == Class::SyntheticUnknown {
            // Its size must also differ from the classes that are known in addition to the family's.
            let sizes = self.options.also_known().map(|c| mean_size_m(c, family));
            let sizes: Vec<_> = sizes.map(|m| m.to_array().map(f64::from)).collect();
            let size = |m: &Model| m.size_m().to_array().map(f64::from);
            let mut also_known = self.options.also_known();
            let has_large = also_known.any(|c| matches!(c, Class::Van | Class::Truck));
            for _ in 0..ATTEMPTS {
                let size_m = size(&model);
                if !(has_known_size(size_m, &sizes) || has_large && is_large(size_m)) {
                    break;
                }
                model = build(class, family, dice);
            }
        }
        model
    }

    /// Places one object, sometimes with more of its class (a row of cars, a group of people), at most `limit`; returns their number.
    fn place_some(&mut self, class: Class, limit: usize, dice: &mut Dice) -> usize {
        let model = self.model(class, dice);
        // A new range is drawn only after many positions at the old one: else near ranges, where fewer objects fit, would become rare.
        let mut range = 0.0;
        let Some(pose) = (0..ATTEMPTS).find_map(|attempt| {
            if attempt % ATTEMPTS_PER_RANGE == 0 {
                let drawn = dice.quantile(&range_knots(class));
                range = self.nearer(class, drawn, dice);
            }
            let pose = self.pose(class, range, dice)?;
            self.fits(&model, pose, dice).then_some(pose)
        }) else {
            return 0;
        };
        let mut last = (pose, model.size_m().x);
        self.put(class, model, pose);
        let (family, split) = (self.options.family, self.options.split);
        let is_across = self.is_across(pose.2);
        let company = match class {
            // Rows are in bays; a car that drives through a lane is alone.
            Class::Car if self.ground.place == Place::CarPark && !is_across => 0,
            Class::Car if self.ground.place == Place::CarPark => dice.whole(0, 6),
            Class::Car if is_across && (family, split) == (Family::SimAny, Split::Train) => {
                dice.whole(1, 9)
            }
            Class::Car if dice.chance(0.45) => dice.whole(1, 4),
            Class::Pedestrian if dice.chance(0.45) => dice.whole(1, 3),
            _ => 0,
        };
        let mut count = 1;
        for _ in 0..company.min(limit - 1) {
            let model = self.model(class, dice);
            let pose = self.beside(class, last, model.size_m().x, dice);
            if self.fits(&model, pose, dice) {
                last = (pose, model.size_m().x);
                self.put(class, model, pose);
                count += 1;
            }
        }
        count
    }

    /// Whether this heading is more across the road than along it.
    fn is_across(&self, yaw: f32) -> bool {
        (yaw - self.ground.yaw_rad).sin().abs() > 0.5
    }

    /// The next position in a row of cars (along the road or side by side), or next to a person.
    fn beside(&self, class: Class, last: (Pose, f32), length: f32, dice: &mut Dice) -> Pose {
        let ((x, y, yaw), last_length) = last;
        if class == Class::Pedestrian {
            let (angle, away) = (dice.range(0.0, TAU), dice.range(0.7, 1.6));
            let heading = if dice.chance(0.6) { yaw + dice.spread(0.3) } else { dice.spread(PI) };
            return (x + away * angle.cos(), y + away * angle.sin(), heading);
        }
        let across = self.is_across(yaw);
        let step = if across && self.ground.place == Place::CarPark {
            places::BAY_M
        } else if across {
            dice.range(2.3, 3.0)
        } else {
            (length + last_length) / 2.0 + dice.range(0.5, 1.6)
        };
        let (sin, cos) = self.ground.yaw_rad.sin_cos();
        // Rows that start far away continue towards the sensor, so that they stay in view.
        let away = x * cos + y * sin > 28.0;
        let step = if away { -step } else { step };
        let yaw = yaw + half_turn(dice.chance(0.15)) + dice.normal(0.0, 0.02);
        (x + step * cos, y + step * sin, yaw)
    }

    fn put(&mut self, class: Class, model: Model, (x, y, yaw): Pose) {
        let footprint = Footprint::of(model.low, model.high, [x, y], yaw);
        self.taken.push(footprint);
        self.placed.push(Placed { class, model, footprint });
    }

    fn fits(&self, model: &Model, pose: Pose, dice: &mut Dice) -> bool {
        let (x, y, yaw) = pose;
        let inside = match self.options.family {
            Family::SimUdi => x.abs() < 50.0 && y.abs() < 50.0,
            // The limit of the network's range; the trainer mirrors objects ahead.
            Family::SimAny => {
                let is_train = self.options.split == Split::Train;
                let behind_m = if is_train { 69.0 } else { 50.0 };
                x > -behind_m && x < 69.0 && y.abs() < 50.0
            }
            // Outside the camera's view only sometimes.
            Family::SimKitti => {
                x > 2.0 && x < 69.5 && y.abs() < 39.0 && (y.abs() < 0.8 * x || dice.chance(0.3))
            }
        };
        let own = Footprint::of(model.low, model.high, [x, y], yaw);
        let mut taken = self.taken.iter();
        inside && self.has_room(model, pose) && !taken.any(|other| own.overlaps(other, 0.25))
    }

    /// Draws a position for an object of this class at this range; `None` when the range does not reach the position across the road.
    fn pose(&self, class: Class, range: f32, dice: &mut Dice) -> Option<Pose> {
        if self.ground.place == Place::Plaza && dice.chance(0.7) {
            return Some(self.anywhere(class, range, dice));
        }
        if let Some(pose) = self.off_street(class, range, dice) {
            return Some(pose);
        }
        match class {
            Class::Pedestrian => self.pedestrian(range, dice),
            Class::SyntheticUnknown if dice.chance(0.3) => self.pedestrian(range, dice),
            Class::Unseen(class) if class.habit() != Habit::Road => self.pedestrian(range, dice),
            Class::Cyclist => self.cyclist(range, dice),
            _ => self.vehicle(class, range, dice),
        }
    }

    /// A pose at this position across the road and this range; `yaw` is relative to the road.
    fn at(&self, across: f32, range: f32, yaw: f32, dice: &mut Dice) -> Option<Pose> {
        let w = across - self.ground.lane_m;
        let along = (range * range - w * w).max(0.0).sqrt();
        if along == 0.0 && w.abs() > 1.3 * range {
            return None;
        }
        let forward = match self.options.family {
            Family::SimKitti => 1.0,
            Family::SimUdi | Family::SimAny => dice.sign(),
        };
        let (x, y) = self.ground.sensor(forward * along, across);
        Some((x, y, self.ground.yaw_rad + yaw))
    }

    fn vehicle(&self, class: Class, range: f32, dice: &mut Dice) -> Option<Pose> {
        let g = self.ground;
        let is_car = self.options.family == Family::SimAny && class == Class::Car;
        if is_car && dice.chance(OWN_LANE_CHANCE) {
            // Of a car ahead the sensor sees only the rear, of a car behind only the front.
            let across = g.lane_m + dice.normal(0.0, 0.25);
            return self.at(across, range, dice.normal(0.0, 0.03), dice);
        }
        let side = dice.sign();
        if is_car && self.options.split == Split::Train && dice.chance(KERB_BAY_CHANCE) {
            // Of most cars in such a row the sensor sees only the front or the rear, at a flat angle.
            let slant = if dice.chance(0.7) { FRAC_PI_2 } else { dice.range(0.9, 1.4) };
            let yaw = dice.sign() * slant + dice.normal(0.0, 0.04);
            let across = side * (g.half_width_m + dice.range(1.6, 3.2));
            return self.at(across, range, yaw, dice);
        }
        let weights = match class {
            Class::GolfCart | Class::Forklift => [0.2, 0.25, 0.35, 0.2],
            _ => [0.34, 0.3, 0.2, 0.16],
        };
        let (across, yaw) = match dice.weighted(&weights) {
            0 => {
                let across = side * g.half_width_m * dice.range(0.35, 0.6);
                (across, half_turn(side > 0.0) + dice.normal(0.0, 0.05))
            }
            1 => {
                let across = side * (g.half_width_m - dice.range(0.2, 1.2));
                let yaw = half_turn(dice.chance(0.75) != (side < 0.0));
                (across, yaw + dice.normal(0.0, 0.04))
            }
            2 => {
                let across = side * (g.edge_m + dice.range(1.0, 14.0));
                let quarter = FRAC_PI_2 * dice.whole(0, 3) as f32;
                (across, quarter + dice.normal(0.0, 0.08))
            }
            _ => {
                let Some([at, half]) = g.crossing else {
                    return Some(self.anywhere(class, range, dice));
                };
                let yaw = side * FRAC_PI_2 + dice.normal(0.0, 0.08);
                let (x, y) = g.sensor(at + side * half * 0.5, dice.spread(30.0));
                return Some((x, y, g.yaw_rad + yaw));
            }
        };
        self.at(across, range, yaw, dice)
    }

    fn pedestrian(&self, range: f32, dice: &mut Dice) -> Option<Pose> {
        let g = self.ground;
        let side = dice.sign();
        let (across, yaw) = match dice.weighted(&[0.62, 0.2, 0.18]) {
            0 => {
                let across = side * dice.range(g.half_width_m + 0.3, g.edge_m + 0.3);
                let yaw = match dice.weighted(&[0.35, 0.35, 0.3]) {
                    0 => dice.normal(0.0, 0.15),
                    1 => PI + dice.normal(0.0, 0.15),
                    _ => dice.spread(PI),
                };
                (across, yaw)
            }
            1 => {
                let across = dice.spread(g.half_width_m);
                (across, side * FRAC_PI_2 + dice.normal(0.0, 0.2))
            }
            _ => return Some(self.anywhere(Class::Pedestrian, range, dice)),
        };
        self.at(across, range, yaw, dice)
    }

    fn cyclist(&self, range: f32, dice: &mut Dice) -> Option<Pose> {
        let g = self.ground;
        let side = dice.sign();
        let direction = half_turn(side > 0.0);
        let (across, yaw) = match dice.weighted(&[0.55, 0.25, 0.2]) {
            0 => {
                let across = side * (g.half_width_m - dice.range(0.4, 2.6));
                (across, direction + dice.normal(0.0, 0.1))
            }
            1 => {
                let across = side * dice.range(g.half_width_m + 0.4, g.edge_m);
                let yaw = direction + half_turn(dice.chance(0.3));
                (across, yaw + dice.normal(0.0, 0.15))
            }
            _ => return Some(self.anywhere(Class::Cyclist, range, dice)),
        };
        self.at(across, range, yaw, dice)
    }

    /// Any azimuth, any heading.
    fn anywhere(&self, class: Class, range: f32, dice: &mut Dice) -> Pose {
        let azimuth = match self.options.family {
            Family::SimUdi | Family::SimAny => dice.spread(PI),
            Family::SimKitti => dice.spread(0.75),
        };
        let yaw = if class == Class::Pedestrian || dice.chance(0.5) {
            dice.spread(PI)
        } else {
            let quarter = FRAC_PI_2 * dice.whole(0, 3) as f32;
            self.ground.yaw_rad + quarter + dice.normal(0.0, 0.05)
        };
        (range * azimuth.cos(), range * azimuth.sin(), yaw)
    }
}

/// A heading relative to the road, rad: reversed or along it.
pub(crate) fn half_turn(around: bool) -> f32 {
    if around { PI } else { 0.0 }
}

/// Shares of the range knots below.
const RANGE_SHARES: [f32; 7] = [0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0];

/// Distribution of the distance of KITTI's labels (percentiles of the public training labels), m.
fn range_knots(class: Class) -> [(f32, f32); 7] {
    let ranges_m = match class {
        Class::Unseen(class) if class.habit() != Habit::Road => {
            return range_knots(Class::Pedestrian);
        }
        Class::Unseen(_) => return range_knots(Class::GolfCart),
        Class::Car | Class::SyntheticUnknown => [3.5, 7.7, 18.1, 28.8, 41.8, 62.2, 72.0],
        Class::Pedestrian => [3.5, 7.3, 10.5, 17.4, 27.0, 41.6, 60.0],
        Class::Cyclist => [4.0, 7.9, 14.2, 21.7, 30.5, 42.3, 60.0],
        Class::Van => [5.0, 9.7, 20.6, 33.7, 50.0, 65.0, 70.0],
        Class::Truck => [6.0, 11.1, 26.0, 38.0, 48.0, 64.0, 72.0],
        Class::GolfCart | Class::Forklift => [4.0, 7.0, 14.0, 22.0, 32.0, 45.0, 50.0],
    };
    std::array::from_fn(|i| (RANGE_SHARES[i], ranges_m[i]))
}
