//! Trucks: cab, gap, and one of five kinds of load; axles by length; an open space under the frame.

use super::super::mesh::{GLASS, METAL, Mesh, RETRO, Surface, V3, circle, solid, v};
use super::super::random::Dice;
use super::vehicle::{axle, occupant, paint, seat};
use super::{Model, fit};

/// A truck of 5.5 to 16 m.
pub(super) fn truck(dice: &mut Dice) -> Model {
    let length = dice.normal(9.7, 2.2).clamp(5.5, 16.0);
    let width = dice.normal(2.58, 0.16);
    let size = v(length, width, dice.normal(3.3, 0.33).clamp(2.5, 4.0));
    let mut mesh = Mesh::default();
    let cab_length = dice.range(1.6, 2.3).min(0.3 * size.x);
    let gap = dice.range(0.2, 0.8);
    let frame = dice.range(0.95, 1.15);
    let cab_height = dice.range(2.5, 3.2).min(size.z);
    let front = size.x / 2.0;
    let cab_size = v(cab_length, size.y * 0.97, cab_height);
    cab(&mut mesh, front, cab_size, dice);
    let chassis = v(size.x - cab_length * 0.6, size.y * 0.35, 0.25);
    let chassis_at = v(-cab_length * 0.3, 0.0, frame - 0.18);
    mesh.block(chassis_at, chassis, solid(0.12));
    let bed = Bed {
        front: front - cab_length - gap,
        rear: -front,
        width: size.y,
        frame,
        top: size.z,
    };
    cargo(&mut mesh, bed, dice);
    axles(&mut mesh, front, size, dice);
    // Under-ride guards and tail lamps.
    for side in [-1.0, 1.0] {
        let guard = v(-0.08 * size.x, side * size.y * 0.46, 0.62);
        mesh.block(guard, v(0.28 * size.x, 0.04, 0.12), METAL);
        let lamp = v(-front + 0.03, side * size.y * 0.36, 0.8);
        mesh.block(lamp, v(0.05, 0.35, 0.16), RETRO);
    }
    let bumper = v(0.08, size.y * 0.9, 0.13);
    mesh.block(v(-front + 0.05, 0.0, 0.55), bumper, METAL);
    mesh.roughen(0.008, dice);
    fit(&mut mesh, size);
    let mut mirrors = Mesh::default();
    let left = v(front - 0.25, size.y / 2.0 + 0.16, cab_height * 0.68);
    mirrors.twins(left, v(0.1, 0.22, 0.5), solid(0.1));
    Model::new(mesh, &mirrors)
}

/// Cab with raked windscreen; `size` is its length, width and top height.
fn cab(mesh: &mut Mesh, front: f32, size: V3, dice: &mut Dice) {
    let colour = paint(dice);
    let rear = front - size.x;
    let half = size.y / 2.0;
    let (sill, belt) = (0.45, size.z * dice.range(0.55, 0.62));
    let rake = dice.range(0.08, 0.3);
    let ring = |z: f32, back: f32, half: f32| -> Vec<V3> {
        vec![
            v(front - back, half * 0.9, z),
            v(front - back - 0.18, half, z),
            v(rear + 0.35 * size.x, half, z),
            v(rear, half, z),
            v(rear, -half, z),
            v(rear + 0.35 * size.x, -half, z),
            v(front - back - 0.18, -half, z),
            v(front - back, -half * 0.9, z),
        ]
    };
    let rings = [
        ring(sill, 0.0, half),
        ring(belt, 0.03, half),
        ring(size.z - 0.35, rake, half * 0.97),
        ring(size.z - 0.05, rake + 0.15, half * 0.9),
    ];
    mesh.loft(&rings, true, |level, point| {
        Some(if level == 1 && matches!(point, 7 | 1 | 5) {
            GLASS
        } else {
            colour
        })
    });
    mesh.cap(&rings[0], colour);
    mesh.cap(&rings[3], colour);
    let bumper = v(0.06, size.y * 0.95, 0.3);
    mesh.block(v(front - 0.03, 0.0, 0.6), bumper, solid(0.2));
    let seats_x = front - 0.55 * size.x;
    for side in [-1.0, 1.0] {
        seat(mesh, v(seats_x, side * half * 0.5, belt - 0.35), 0.5);
    }
    if dice.chance(0.5) {
        occupant(mesh, v(seats_x, half * 0.5, belt - 0.2), dice);
    }
}

/// The space for the load: its ends along x, width, floor and top.
#[derive(Clone, Copy)]
struct Bed {
    front: f32,
    rear: f32,
    width: f32,
    frame: f32,
    top: f32,
}

impl Bed {
    fn length(self) -> f32 {
        self.front - self.rear
    }

    fn middle(self) -> f32 {
        (self.front + self.rear) / 2.0
    }

    fn height(self) -> f32 {
        self.top - self.frame
    }
}

fn cargo(mesh: &mut Mesh, bed: Bed, dice: &mut Dice) {
    let colour = paint(dice);
    let (length, height) = (bed.length(), bed.height());
    let center = v(bed.middle(), 0.0, bed.frame + height / 2.0);
    match dice.weighted(&[0.42, 0.2, 0.14, 0.12, 0.12]) {
        0 => {
            let light = solid(colour.rho.max(0.25));
            mesh.block(center, v(length, bed.width, height), light);
            ribs(mesh, bed, colour, 2);
        }
        1 => {
            let size = v(length, bed.width * 0.98, height);
            mesh.tapered(center, size, 0.99, 0.93, colour);
            ribs(mesh, bed, colour, 7);
        }
        2 => flatbed(mesh, bed, dice),
        3 => tank(mesh, bed),
        _ => tipper(mesh, bed, colour),
    }
}

/// Vertical ribs along both sides: a box is never one plane.
fn ribs(mesh: &mut Mesh, bed: Bed, colour: Surface, count: usize) {
    for i in 0..=count {
        let x = bed.rear + bed.length() * i as f32 / count as f32;
        let left = v(x, bed.width / 2.0 - 0.01, (bed.frame + bed.top) / 2.0);
        mesh.twins(left, v(0.08, 0.05, bed.height() * 0.96), colour);
    }
}

fn flatbed(mesh: &mut Mesh, bed: Bed, dice: &mut Dice) {
    let (length, width, frame) = (bed.length(), bed.width, bed.frame);
    let floor = v(bed.middle(), 0.0, frame + 0.08);
    mesh.block(floor, v(length, width, 0.16), solid(0.25));
    let wall = v(bed.front - 0.05, 0.0, frame + 0.6);
    mesh.block(wall, v(0.08, width, 1.2), METAL);
    let pieces = dice.whole(1, 4);
    for i in 0..pieces {
        let room = length / pieces as f32;
        let h = dice.range(0.4, bed.top - frame - 0.2);
        let x = bed.rear + room * (i as f32 + 0.5);
        let at = v(x, dice.spread(0.2), frame + 0.16 + h / 2.0);
        let l = room * dice.range(0.5, 0.95);
        let size = v(l, width * dice.range(0.5, 0.9), h);
        mesh.block(at, size, solid(dice.range(0.1, 0.6)));
    }
}

fn tank(mesh: &mut Mesh, bed: Bed) {
    let (ry, rz) = (bed.width / 2.0 * 0.98, bed.height() / 2.0);
    let z = bed.frame + rz;
    let ends = [
        (bed.rear, 0.75),
        (bed.rear + 0.25, 1.0),
        (bed.front - 0.25, 1.0),
        (bed.front, 0.75),
    ];
    let rings =
        ends.map(|(x, scale)| circle(12, 0.0, |c, s| v(x, ry * c * scale, z + rz * s * scale)));
    mesh.loft(&rings, true, |_, _| Some(solid(0.5)));
    mesh.cap(&rings[0], METAL);
    mesh.cap(&rings[3], METAL);
}

fn tipper(mesh: &mut Mesh, bed: Bed, colour: Surface) {
    let (length, middle, width, frame) = (bed.length(), bed.middle(), bed.width, bed.frame);
    let height = bed.height();
    let wall = height * 0.75;
    mesh.block(v(middle, 0.0, frame + 0.05), v(length, width, 0.1), colour);
    let left = v(middle, width / 2.0 - 0.04, frame + wall / 2.0);
    mesh.twins(left, v(length, 0.08, wall), colour);
    for (x, height) in [(bed.rear + 0.04, wall), (bed.front - 0.04, height)] {
        let at = v(x, 0.0, frame + height / 2.0);
        mesh.block(at, v(0.08, width, height), colour);
    }
    let heap = v(length * 0.95, width * 0.92, 0.8 * wall);
    let heap_at = v(middle, 0.0, frame + 0.4 * wall);
    mesh.tapered(heap_at, heap, 0.4, 0.4, solid(0.2));
}

fn axles(mesh: &mut Mesh, front: f32, size: V3, dice: &mut Dice) {
    let radius = dice.range(0.44, 0.54);
    let mut positions = vec![front - dice.range(0.9, 1.4)];
    let rear = -front + dice.range(1.2, 2.2);
    positions.push(rear);
    if size.x > 8.0 {
        positions.push(rear + 1.3);
    }
    if size.x > 11.5 {
        positions.push(front - 4.2);
        positions.push(rear + 2.6);
    }
    for x in positions {
        axle(mesh, x, size.y / 2.0 - 0.22, radius, 0.35);
    }
}
