//! Positions of objects in the places of `sim-any` that are no streets.

use super::super::place::ROBOT_M;
use super::*;

/// Width of a lane with a row of cars on both sides, m.
pub(crate) const AISLE_M: f32 = 16.0;
/// From the middle of a lane to the middle of its rows, m.
const ROW_M: f32 = 5.5;
/// Width of a parking bay, m.
pub(crate) const BAY_M: f32 = 2.55;

/// Number of objects, and the weights of car, pedestrian, cyclist and truck.
pub(super) fn known(place: Place, dice: &mut Dice) -> (usize, [f32; 4]) {
    match place {
        Place::CarPark => (dice.whole(26, 56), [0.78, 0.15, 0.07, 0.0]),
        Place::Depot => (dice.whole(12, 28), [0.42, 0.36, 0.22, 0.0]),
        Place::Hall => (dice.whole(8, 20), [0.1, 0.68, 0.22, 0.0]),
        Place::Path => (dice.whole(12, 26), [0.12, 0.48, 0.4, 0.0]),
        _ => (dice.whole(14, 34), [0.5, 0.28, 0.22, 0.0]),
    }
}

impl Layout<'_> {
    /// A range for this frame of `sim-any`: within the room, and shorter for people around a robot than around a car.
    pub(super) fn nearer(&self, class: Class, range_m: f32, dice: &mut Dice) -> f32 {
        if self.options.family != Family::SimAny {
            return range_m;
        }
        let room = self.ground.room.as_ref();
        let in_room = room.map_or(1.0, |room| (room.reach_m() / 55.0).min(1.0));
        let is_robot = -self.ground.height(0.0, 0.0) < ROBOT_M;
        let near = if is_robot && matches!(class, Class::Pedestrian | Class::Cyclist) {
            dice.range(0.35, 1.0)
        } else {
            1.0
        };
        (range_m * in_room * near).max(1.5)
    }

    /// Whether the ground is flat enough for an upright label, and walls and ceiling leave room.
    pub(super) fn has_room(&self, model: &Model, (x, y, _): Pose) -> bool {
        let (gx, gy) = self.ground.gradient(x, y);
        let size = model.size_m();
        let reach_m = size.x.hypot(size.y) / 2.0 + 0.3;
        let in_room = self.ground.room.as_ref().is_none_or(|room| {
            room.holds(self.ground.road(x, y), reach_m) && size.z < room.height_m - 0.25
        });
        in_room && gx.hypot(gy) < 0.115
    }

    /// A pose in one of these places; `None`: use the pose of a street.
    pub(super) fn off_street(&self, class: Class, range: f32, dice: &mut Dice) -> Option<Pose> {
        let is_person = matches!(class, Class::Pedestrian | Class::Cyclist);
        match self.ground.place {
            Place::CarPark if class == Class::Car && dice.chance(0.88) => self.bay(range, dice),
            Place::CarPark if !is_person || dice.chance(0.6) => {
                let across = AISLE_M * dice.spread(1.49).round() + dice.spread(2.0);
                let yaw = half_turn(dice.chance(0.5)) + dice.normal(0.0, 0.1);
                self.at(across, range, yaw, dice)
            }
            Place::CarPark | Place::Hall => Some(self.anywhere(class, range, dice)),
            Place::Depot if dice.chance(0.6) => Some(self.anywhere(class, range, dice)),
            _ => None,
        }
    }

    /// A bay of a row; the lanes stay free.
    fn bay(&self, range: f32, dice: &mut Dice) -> Option<Pose> {
        let aisle = AISLE_M * dice.spread(2.49).round();
        let across = aisle + dice.sign() * ROW_M;
        if across.abs() > self.ground.half_width_m - 2.4 {
            return None;
        }
        let side = dice.sign();
        let yaw = side * FRAC_PI_2 + dice.normal(0.0, 0.03);
        let (x, y, yaw) = self.at(across, range, yaw, dice)?;
        let (along, _) = self.ground.road(x, y);
        let along = ((along / BAY_M).round() + 0.5) * BAY_M + dice.spread(0.1);
        let (x, y) = self.ground.sensor(along, across + dice.spread(0.3));
        Some((x, y, yaw))
    }
}
