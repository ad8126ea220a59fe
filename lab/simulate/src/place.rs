//! The places of `sim-any` besides streets: how often each is seen, and the room that some of them are.

use super::ground::Place;
use super::random::Dice;

/// Sensors below this height ride on small robots, m.
pub(crate) const ROBOT_M: f32 = 1.35;

/// A building around the sensor, in the road frame: from the middle of the road `half_width_m` to both sides.
#[derive(Clone, Debug)]
pub(crate) struct Room {
    /// First and last wall along the road, m.
    pub(crate) along_m: [f32; 2],
    pub(crate) half_width_m: f32,
    /// Height of the ceiling, m.
    pub(crate) height_m: f32,
}

impl Room {
    /// Of a hall always, of a car park when it is covered: the ceiling stays half a metre above the sensor.
    pub(crate) fn draw(place: Place, sensor_height_m: f32, dice: &mut Dice) -> Option<Room> {
        let (length_m, half_width_m, height_m) = match place {
            Place::Hall => {
                let lowest_m = (sensor_height_m + 1.0).max(4.0);
                let width_m = dice.range(7.0, 24.0);
                (dice.range(18.0, 80.0), width_m, dice.range(lowest_m, 9.0))
            }
            Place::CarPark if sensor_height_m < 2.1 && dice.chance(0.45) => {
                let lowest_m = (sensor_height_m + 0.5).max(2.3);
                let width_m = [13.0, 21.0, 29.0][dice.whole(0, 2)];
                (dice.range(40.0, 100.0), width_m, dice.range(lowest_m, 3.0))
            }
            _ => return None,
        };
        let behind_m = dice.range(5.0, length_m - 5.0);
        Some(Room {
            along_m: [-behind_m, length_m - behind_m],
            half_width_m,
            height_m,
        })
    }

    /// Whether a thing of this reach stands clear of the walls.
    pub(crate) fn holds(&self, (along, across): (f32, f32), reach_m: f32) -> bool {
        let [low, high] = self.along_m;
        along - reach_m > low
            && along + reach_m < high
            && across.abs() + reach_m < self.half_width_m
    }

    /// Farthest wall from the sensor, m.
    pub(crate) fn reach_m(&self) -> f32 {
        let [low, high] = self.along_m;
        high.max(-low).max(self.half_width_m)
    }
}

/// A place that is no street, in two frames of five: robots see halls and paths more than cars do.
pub(crate) fn besides_streets(sensor_height_m: f32, dice: &mut Dice) -> Option<Place> {
    let (chance, weights) = if sensor_height_m < ROBOT_M {
        (0.55, [0.2, 0.17, 0.36, 0.27])
    } else {
        (0.36, [0.4, 0.25, 0.13, 0.22])
    };
    let places = [Place::CarPark, Place::Depot, Place::Hall, Place::Path];
    dice.chance(chance).then(|| places[dice.weighted(&weights)])
}
