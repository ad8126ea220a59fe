//! Trucks: cab, gap, and one of five kinds of load; number of axles by length; an open space under the frame.

use super::super::mesh::{GLASS, METAL, Mesh, RETRO, Surface, V3, circle, mirrored, solid, v};
use super::vehicle::{axle, occupant, paint, seat};
use crate::{objects::Model, random::Dice};

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
    let low = v(-front, -size.y / 2.0, frame);
    let high = v(front - cab_length - gap, size.y / 2.0, size.z);
    cargo(&mut mesh, low, high, dice);
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
    mesh.fit(size);
    let left = v(front - 0.25, size.y / 2.0 + 0.16, cab_height * 0.68);
    Model::with_mirrors(mesh, left, v(0.1, 0.22, 0.5), solid(0.1))
}

/// Cab with raked windscreen; `size` is its length, width and top height.
fn cab(mesh: &mut Mesh, front: f32, size: V3, dice: &mut Dice) {
    let colour = paint(dice);
    let rear = front - size.x;
    let half = size.y / 2.0;
    let belt = size.z * dice.range(0.55, 0.62);
    let rake = dice.range(0.08, 0.3);
    let ring = |z: f32, back: f32, half: f32| {
        mirrored(&[
            v(front - back, half * 0.9, z),
            v(front - back - 0.18, half, z),
            v(rear + 0.35 * size.x, half, z),
            v(rear, half, z),
        ])
    };
    let rings = [
        ring(0.45, 0.0, half),
        ring(belt, 0.03, half),
        ring(size.z - 0.35, rake, half * 0.97),
        ring(size.z - 0.05, rake + 0.15, half * 0.9),
    ];
    mesh.loft(&rings, true, |level, point| match (level, point) {
        (1, 7 | 1 | 5) => GLASS,
        _ => colour,
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

/// One of five kinds of load between two corners.
fn cargo(mesh: &mut Mesh, low: V3, high: V3, dice: &mut Dice) {
    let colour = paint(dice);
    let size = high - low;
    let center = v((low.x + high.x) / 2.0, 0.0, low.z + size.z / 2.0);
    match dice.weighted(&[0.42, 0.2, 0.14, 0.12, 0.12]) {
        0 => {
            mesh.block(center, size, solid(colour.rho.max(0.25)));
            ribs(mesh, low, high, colour, 2);
        }
        1 => {
            let size = size * v(1.0, 0.98, 1.0);
            mesh.tapered(center, size, [0.99, 0.93], colour);
            ribs(mesh, low, high, colour, 7);
        }
        2 => flatbed(mesh, low, high, dice),
        3 => tank(mesh, low, high),
        _ => tipper(mesh, low, high, colour),
    }
}

/// Vertical ribs along both sides: no side of a box is a single plane.
fn ribs(mesh: &mut Mesh, low: V3, high: V3, colour: Surface, count: usize) {
    let size = high - low;
    for i in 0..=count {
        let x = low.x + size.x * i as f32 / count as f32;
        let left = v(x, size.y / 2.0 - 0.01, (low.z + high.z) / 2.0);
        mesh.twins(left, v(0.08, 0.05, size.z * 0.96), colour);
    }
}

fn flatbed(mesh: &mut Mesh, low: V3, high: V3, dice: &mut Dice) {
    let size = high - low;
    let floor = v((low.x + high.x) / 2.0, 0.0, low.z + 0.08);
    mesh.block(floor, v(size.x, size.y, 0.16), solid(0.25));
    let wall = v(high.x - 0.05, 0.0, low.z + 0.6);
    mesh.block(wall, v(0.08, size.y, 1.2), METAL);
    let pieces = dice.whole(1, 4);
    for i in 0..pieces {
        let room = size.x / pieces as f32;
        let h = dice.range(0.4, size.z - 0.2);
        let x = low.x + room * (i as f32 + 0.5);
        let at = v(x, dice.spread(0.2), low.z + 0.16 + h / 2.0);
        let l = room * dice.range(0.5, 0.95);
        let piece = v(l, size.y * dice.range(0.5, 0.9), h);
        mesh.block(at, piece, solid(dice.range(0.1, 0.6)));
    }
}

fn tank(mesh: &mut Mesh, low: V3, high: V3) {
    let (ry, rz) = (high.y * 0.98, (high.z - low.z) / 2.0);
    let ring = |x: f32, scale: f32| {
        circle(12, 0.0, |c, s| v(x, ry * c * scale, low.z + rz + rz * s * scale))
    };
    let (rear, front) = (low.x + 0.25, high.x - 0.25);
    let ends = [(low.x, 0.75), (rear, 1.0), (front, 1.0), (high.x, 0.75)];
    let rings = ends.map(|(x, scale)| ring(x, scale));
    mesh.loft(&rings, true, |_, _| solid(0.5));
    mesh.cap(&rings[0], METAL);
    mesh.cap(&rings[3], METAL);
}

fn tipper(mesh: &mut Mesh, low: V3, high: V3, colour: Surface) {
    let size = high - low;
    let middle = (low.x + high.x) / 2.0;
    let wall = size.z * 0.75;
    let floor = v(size.x, size.y, 0.1);
    mesh.block(v(middle, 0.0, low.z + 0.05), floor, colour);
    let left = v(middle, high.y - 0.04, low.z + wall / 2.0);
    mesh.twins(left, v(size.x, 0.08, wall), colour);
    for (x, height) in [(low.x + 0.04, wall), (high.x - 0.04, size.z)] {
        let at = v(x, 0.0, low.z + height / 2.0);
        mesh.block(at, v(0.08, size.y, height), colour);
    }
    let heap = v(size.x * 0.95, size.y * 0.92, 0.8 * wall);
    let heap_at = v(middle, 0.0, low.z + 0.4 * wall);
    mesh.tapered(heap_at, heap, [0.4, 0.4], solid(0.2));
}

fn axles(mesh: &mut Mesh, front: f32, size: V3, dice: &mut Dice) {
    let radius = dice.range(0.44, 0.54);
    let [fore, rear] = [front - dice.range(0.9, 1.4), -front + dice.range(1.2, 2.2)];
    let mut positions = vec![fore, rear];
    if size.x > 8.0 {
        positions.push(rear + 1.3);
    }
    if size.x > 11.5 {
        positions.extend([front - 4.2, rear + 2.6]);
    }
    for x in positions {
        axle(mesh, x, size.y / 2.0 - 0.22, radius, 0.35);
    }
}
