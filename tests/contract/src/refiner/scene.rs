//! Synthetic scans: flat ground, boxes that stand on it, and a head's detections of them. Pseudo-random values are always the same.

use mluc_ipc_types::{CLASSES_MAX, Detection, DetectionKind, GateKind, NO_PROBABILITY, Point};

const SENSOR_HEIGHT_M: f32 = 1.73;

/// A box that stands on the ground.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Thing {
    pub(crate) x_m: f32,
    pub(crate) y_m: f32,
    pub(crate) size_m: [f32; 3],
}

pub(crate) const CART: Thing = Thing { x_m: 12.0, y_m: 1.0, size_m: [2.6, 1.25, 1.85] };
pub(crate) const CAR: Thing = Thing { x_m: 18.0, y_m: -6.0, size_m: [4.2, 1.8, 1.5] };

impl Thing {
    fn center_m(&self) -> [f32; 3] {
        [self.x_m, self.y_m, self.size_m[2] / 2.0 - SENSOR_HEIGHT_M]
    }
}

/// Evenly distributed numbers from 0 to 1 that never repeat.
fn share(number: usize, step: f64) -> f32 {
    (number as f64 * step).fract() as f32
}

/// `count` points: a third of them on the sides of `things` that face the sensor, the others on the ground to 60 m.
pub(crate) fn scan(things: &[Thing], count: usize) -> Vec<Point> {
    let point = |number: usize| {
        if number < count / 3 {
            return on_sides(&things[number % things.len()], number);
        }
        let angle = share(number, 0.618_034) * std::f32::consts::TAU;
        let range = 3.0 + 57.0 * share(number, 0.414_214);
        let (sin, cos) = angle.sin_cos();
        bytemuck::cast([range * cos, range * sin, -SENSOR_HEIGHT_M, 0.3])
    };
    (0..count).map(point).collect()
}

/// A point on one of the two sides of a box that the sensor sees.
fn on_sides(thing: &Thing, number: usize) -> Point {
    let [l, w, h] = thing.size_m;
    let along = share(number, 0.618_034) - 0.5;
    let toward = -thing.y_m.signum();
    let (dx, dy) = match number / 7 % 2 {
        0 => (-l / 2.0, w * along),
        _ => (l * along, toward * w / 2.0),
    };
    let z_m = share(number, 0.414_214) * h - SENSOR_HEIGHT_M;
    bytemuck::cast([thing.x_m + dx, thing.y_m + dy, z_m, 0.6])
}

pub(crate) fn blob(thing: &Thing, count: usize) -> Vec<Point> {
    let [x, y, z] = thing.center_m();
    let point = |number| Point {
        x_m: x + 3.0 * (share(number, 0.618_034) - 0.5),
        y_m: y + 3.0 * (share(number, 0.414_214) - 0.5),
        z_m: z + 2.0 * (share(number, 0.732_051) - 0.5),
        intensity: 0.5,
    };
    (0..count).map(point).collect()
}

/// A box of the network that lies between the prototypes: it is shifted and has the size of a wrong class.
pub(crate) fn candidate(thing: &Thing, shift_m: [f32; 2]) -> Detection {
    let mut detection = known(thing);
    detection.kind = DetectionKind::Candidate as u32;
    detection.center_m[0] += shift_m[0];
    detection.center_m[1] += shift_m[1];
    detection.size_m = [1.8, 0.7, 1.7];
    detection.eds_normalised = 0.8;
    detection.eds = 0.8 * 18.0;
    detection
}

/// A box of the network near a prototype.
pub(crate) fn known(thing: &Thing) -> Detection {
    let mut probabilities = [0.0; CLASSES_MAX];
    probabilities[0] = 1.0;
    Detection {
        center_m: thing.center_m(),
        size_m: thing.size_m,
        kind: DetectionKind::Known as u32,
        objectness: 0.9,
        score: 0.9,
        probabilities,
        eds: 36.0,
        eds_normalised: 2.0,
        unknown_probability: NO_PROBABILITY,
        gate: GateKind::Eds as u32,
        threshold: 1.3,
        ..Detection::default()
    }
}

/// The scene of most cases: a known car and an unknown golf cart.
pub(crate) fn usual() -> (Vec<Point>, Vec<Detection>) {
    let detections = vec![known(&CAR), candidate(&CART, [0.4, -0.3])];
    (scan(&[CART, CAR], 20_000), detections)
}
