//! The places of `sim-any` other than streets: how often each occurs, and the room of some of them.

use super::random::Dice;

/// Sensors below this height are on small robots, m.
pub(crate) const ROBOT_M: f32 = 1.35;

/// Kind of place of the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Place {
    /// Houses close to the road, parked rows.
    Urban,
    /// Gardens, hedges, trees.
    Suburb,
    /// Yards, fences, containers.
    Industrial,
    /// A wide paved square or parking place without kerbs.
    Plaza,
    /// Rows of parked cars with lanes between them, open or covered.
    CarPark,
    /// An open paved yard: containers, pallets, machines, piles.
    Depot,
    /// The inside of a hall or a warehouse.
    Hall,
    /// A path in a park or through rough ground.
    Path,
}

impl Place {
    /// Range of half the drivable width where the place is no road, m.
    pub(crate) fn half_width_m(self) -> Option<[f32; 2]> {
        match self {
            Place::Plaza => Some([14.0, 26.0]),
            Place::CarPark => Some([20.0, 36.0]),
            Place::Depot => Some([12.0, 28.0]),
            Place::Path => Some([1.0, 2.0]),
            _ => None,
        }
    }

    /// Whether the place has kerbs and pavements.
    pub(crate) fn is_street(self) -> bool {
        matches!(self, Place::Urban | Place::Suburb | Place::Industrial)
    }
}

/// A building around the sensor, in the road frame: it extends `half_width_m` from the middle of the road to both sides.
#[derive(Clone, Debug)]
pub(crate) struct Room {
    /// First and last wall along the road, m.
    pub(crate) along_m: [f32; 2],
    pub(crate) half_width_m: f32,
    /// Height of the ceiling, m.
    pub(crate) height_m: f32,
}

impl Room {
    /// A hall always has a room, a car park when it is covered: the ceiling is at least half a metre above the sensor.
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
        Some(Room { along_m: [-behind_m, length_m - behind_m], half_width_m, height_m })
    }

    /// Whether a thing of this reach is clear of the walls.
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

/// A place other than a street, in two of five frames: robots are in halls and on paths more often than cars.
pub(crate) fn besides_streets(sensor_height_m: f32, dice: &mut Dice) -> Option<Place> {
    let (chance, weights) = if sensor_height_m < ROBOT_M {
        (0.55, [0.2, 0.17, 0.36, 0.27])
    } else {
        (0.36, [0.4, 0.25, 0.13, 0.22])
    };
    let places = [Place::CarPark, Place::Depot, Place::Hall, Place::Path];
    dice.chance(chance).then(|| places[dice.weighted(&weights)])
}

#[cfg(test)]
mod tests {
    use super::super::background::Thing::{self, *};
    use super::super::{Class, ExportOptions, Family, SimulatedFrame, Split, Step};
    use super::super::{ground::Ground, labels::UNLABELLED, random, simulated};
    use super::*;
    use mluc_model::SensorProfile;

    const HEIGHT_M: f32 = 1.2;

    fn sensor() -> SensorProfile {
        SensorProfile {
            azimuth_step_deg: 0.6,
            // Else it would not see the body of a small robot.
            range_m: [0.1, 100.0],
            height_m: Some(HEIGHT_M),
            ..SensorProfile::load("vlp-32c").expect("a product")
        }
    }

    fn shown(index: u32, left_out: &[Step]) -> SimulatedFrame {
        let options = ExportOptions {
            sensor: Some(sensor()),
            without: left_out.to_vec(),
            ..ExportOptions::new(Family::SimAny, Split::Train, 1, 1, "".into())
        };
        simulated(&options, index).expect("a frame").0
    }

    /// The first frames of a place.
    fn frames_of(place: Place, is_covered: bool, left_out: &[Step]) -> Vec<SimulatedFrame> {
        let family = Family::SimAny as u64;
        let shows = move |index: &u32| {
            let key = random::hash(&[1, family, Split::Train as u64, u64::from(*index)]);
            let dice = &mut Dice::new(&[key, 1]);
            let ground = Ground::draw(Family::SimAny, Some(HEIGHT_M), dice);
            ground.place == place && ground.room.is_some() == is_covered
        };
        (0..400).filter(shows).take(3).map(|index| shown(index, left_out)).collect()
    }

    #[test]
    fn every_place_is_drawn_with_known_objects_its_background_and_ground_below() {
        let (car, person) = (Class::Car, Class::Pedestrian);
        for (place, is_covered, class, least, things) in [
            (Place::Urban, false, car, 6, [Building, Pole]),
            (Place::Suburb, false, car, 6, [Bush, Tree]),
            (Place::Industrial, false, car, 6, [Building, Pole]),
            (Place::Plaza, false, car, 6, [Building, Pole]),
            (Place::CarPark, false, car, 15, [Pole, Building]),
            (Place::CarPark, true, car, 10, [Ceiling, Column]),
            (Place::Depot, false, car, 4, [Pile, Machine]),
            (Place::Hall, true, person, 8, [Ceiling, Building]),
            (Place::Path, false, person, 6, [Grass, Tree]),
        ] {
            let frames = frames_of(place, is_covered, &[]);
            assert_eq!(frames.len(), 3, "{place:?}");
            let of_class =
                |f: &SimulatedFrame| f.objects.iter().filter(|o| o.class == class).count();
            let count: usize = frames.iter().map(of_class).sum();
            assert!(count >= least, "{place:?}: {count} of {class:?}");
            for thing in things {
                let is_shown = |f: &SimulatedFrame| f.instances.contains(&thing.instance());
                assert!(frames.iter().any(is_shown), "{place:?}: no {thing:?}");
            }
            for frame in &frames {
                let below = frame.plane[3] as f32;
                assert!((below - HEIGHT_M).abs() < 0.05, "{place:?}: {below} m");
                let near = |p: &[f32; 4]| p[0].hypot(p[1]) < 8.0;
                let points = frame.points.iter().zip(&frame.instances);
                let ground = points.filter(|(p, i)| **i == 0 && near(p));
                let off: Vec<f32> = ground.map(|(p, _)| (p[2] + HEIGHT_M).abs()).collect();
                let flat = off.iter().filter(|off| **off < 0.9).count();
                let all = off.len();
                assert!(flat * 10 >= all * 9, "{place:?}: {flat} of {all}");
            }
        }
    }

    #[test]
    fn without_frontage_nothing_is_seen_over_the_parapets_of_a_car_park() {
        let outside = [Wall, Fence, Hedge, Bush].map(Thing::instance);
        for frame in frames_of(Place::CarPark, true, &[Step::Frontage]) {
            assert!(!frame.instances.iter().any(|i| outside.contains(i)));
        }
    }

    #[test]
    fn the_own_vehicle_is_seen_without_a_label_and_stands_in_nothing() {
        let is_own = |(p, i): &(&[f32; 4], &u16)| **i == UNLABELLED && p[0].hypot(p[1]) < 1.2;
        let mut seen = 0;
        for frame in (0..24).map(|index| shown(index, &[])) {
            let points = frame.points.iter().zip(&frame.instances);
            let own: Vec<[f32; 4]> = points.filter(is_own).map(|(p, _)| *p).collect();
            seen += usize::from(!own.is_empty());
            for object in &frame.objects {
                assert_eq!(object.box_in_sensor.count_inside(&own), 0, "{object:?}");
            }
        }
        assert!((3..=16).contains(&seen), "{seen} of 24 frames");
    }
}
