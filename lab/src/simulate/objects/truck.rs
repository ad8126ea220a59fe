//! Trucks: cab, gap, and one of five kinds of load; axles by length; an open space under the frame.

use super::super::mesh::{GLASS, METAL, Mesh, RETRO, Surface, V3, solid, v};
use super::super::random::Dice;
use super::vehicle::{occupant, paint, seat, wheel};
use super::{Model, fit};

/// A truck of 5.5 to 16 m.
pub(super) fn truck(dice: &mut Dice) -> Model {
    let size = v(
        dice.normal(9.7, 2.2).clamp(5.5, 16.0),
        dice.normal(2.58, 0.16),
        dice.normal(3.3, 0.33).clamp(2.5, 4.0),
    );
    let mut mesh = Mesh::default();
    let cab_length = dice.range(1.6, 2.3).min(0.3 * size.x);
    let gap = dice.range(0.2, 0.8);
    let frame = dice.range(0.95, 1.15);
    let cab_height = dice.range(2.5, 3.2).min(size.z);
    let front = size.x / 2.0;
    cab(
        &mut mesh,
        front,
        v(cab_length, size.y * 0.97, cab_height),
        dice,
    );
    let chassis = v(size.x - cab_length * 0.6, size.y * 0.35, 0.25);
    mesh.block(
        v(-cab_length * 0.3, 0.0, frame - 0.18),
        chassis,
        solid(0.12),
    );
    let bed_front = front - cab_length - gap;
    cargo(
        &mut mesh,
        bed_front,
        -front,
        v(0.0, size.y, size.z),
        frame,
        dice,
    );
    axles(&mut mesh, front, size, dice);
    // Under-ride guards and tail lamps.
    for side in [-1.0, 1.0] {
        mesh.block(
            v(-0.08 * size.x, side * size.y * 0.46, 0.62),
            v(0.28 * size.x, 0.04, 0.12),
            METAL,
        );
        mesh.block(
            v(-front + 0.03, side * size.y * 0.36, 0.8),
            v(0.05, 0.35, 0.16),
            RETRO,
        );
    }
    mesh.block(
        v(-front + 0.05, 0.0, 0.55),
        v(0.08, size.y * 0.9, 0.13),
        METAL,
    );
    mesh.roughen(0.008, dice);
    fit(&mut mesh, size);
    let mut mirrors = Mesh::default();
    for side in [-1.0, 1.0] {
        mirrors.block(
            v(
                front - 0.25,
                side * (size.y / 2.0 + 0.16),
                cab_height * 0.68,
            ),
            v(0.1, 0.22, 0.5),
            solid(0.1),
        );
    }
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
    mesh.block(
        v(front - 0.03, 0.0, 0.6),
        v(0.06, size.y * 0.95, 0.3),
        solid(0.2),
    );
    for side in [-1.0, 1.0] {
        seat(
            mesh,
            v(front - 0.55 * size.x, side * half * 0.5, belt - 0.35),
            0.5,
        );
    }
    if dice.chance(0.5) {
        occupant(mesh, v(front - 0.55 * size.x, half * 0.5, belt - 0.2), dice);
    }
}

fn cargo(mesh: &mut Mesh, front: f32, rear: f32, size: V3, frame: f32, dice: &mut Dice) {
    let colour = paint(dice);
    let length = front - rear;
    let middle = (front + rear) / 2.0;
    let height = size.z - frame;
    match dice.weighted(&[0.42, 0.2, 0.14, 0.12, 0.12]) {
        0 => {
            mesh.block(
                v(middle, 0.0, frame + height / 2.0),
                v(length, size.y, height),
                solid(colour.rho.max(0.25)),
            );
            ribs(mesh, [front, rear], size, frame, colour, 2);
        }
        1 => {
            mesh.tapered(
                v(middle, 0.0, frame + height / 2.0),
                v(length, size.y * 0.98, height),
                0.99,
                0.93,
                colour,
            );
            ribs(mesh, [front, rear], size, frame, colour, 7);
        }
        2 => flatbed(mesh, [front, rear], size, frame, dice),
        3 => tank(mesh, [front, rear], size, frame, height),
        _ => tipper(mesh, [front, rear], size, frame, height, colour),
    }
}

/// Vertical ribs along both sides: a box is never one plane.
fn ribs(mesh: &mut Mesh, ends: [f32; 2], size: V3, frame: f32, colour: Surface, count: usize) {
    for i in 0..=count {
        let x = ends[1] + (ends[0] - ends[1]) * i as f32 / count as f32;
        for side in [-1.0, 1.0] {
            let z = (frame + size.z) / 2.0;
            mesh.block(
                v(x, side * (size.y / 2.0 - 0.01), z),
                v(0.08, 0.05, (size.z - frame) * 0.96),
                colour,
            );
        }
    }
}

fn flatbed(mesh: &mut Mesh, ends: [f32; 2], size: V3, frame: f32, dice: &mut Dice) {
    let length = ends[0] - ends[1];
    let middle = (ends[0] + ends[1]) / 2.0;
    mesh.block(
        v(middle, 0.0, frame + 0.08),
        v(length, size.y, 0.16),
        solid(0.25),
    );
    mesh.block(
        v(ends[0] - 0.05, 0.0, frame + 0.6),
        v(0.08, size.y, 1.2),
        METAL,
    );
    let pieces = dice.whole(1, 4);
    for i in 0..pieces {
        let room = length / pieces as f32;
        let h = dice.range(0.4, size.z - frame - 0.2);
        let at = v(
            ends[1] + room * (i as f32 + 0.5),
            dice.spread(0.2),
            frame + 0.16 + h / 2.0,
        );
        mesh.block(
            at,
            v(
                room * dice.range(0.5, 0.95),
                size.y * dice.range(0.5, 0.9),
                h,
            ),
            solid(dice.range(0.1, 0.6)),
        );
    }
}

fn tank(mesh: &mut Mesh, ends: [f32; 2], size: V3, frame: f32, height: f32) {
    let (ry, rz) = (size.y / 2.0 * 0.98, height / 2.0);
    let z = frame + rz;
    let ring = |x: f32, scale: f32| -> Vec<V3> {
        (0..12)
            .map(|i| {
                let (s, c) = (std::f32::consts::TAU * i as f32 / 12.0).sin_cos();
                v(x, ry * c * scale, z + rz * s * scale)
            })
            .collect()
    };
    let rings = [
        ring(ends[1], 0.75),
        ring(ends[1] + 0.25, 1.0),
        ring(ends[0] - 0.25, 1.0),
        ring(ends[0], 0.75),
    ];
    mesh.loft(&rings, true, |_, _| Some(solid(0.5)));
    mesh.cap(&rings[0], METAL);
    mesh.cap(&rings[3], METAL);
}

fn tipper(mesh: &mut Mesh, ends: [f32; 2], size: V3, frame: f32, height: f32, colour: Surface) {
    let length = ends[0] - ends[1];
    let middle = (ends[0] + ends[1]) / 2.0;
    let wall = height * 0.75;
    mesh.block(v(middle, 0.0, frame + 0.05), v(length, size.y, 0.1), colour);
    for side in [-1.0, 1.0] {
        mesh.block(
            v(middle, side * (size.y / 2.0 - 0.04), frame + wall / 2.0),
            v(length, 0.08, wall),
            colour,
        );
    }
    mesh.block(
        v(ends[1] + 0.04, 0.0, frame + wall / 2.0),
        v(0.08, size.y, wall),
        colour,
    );
    mesh.block(
        v(ends[0] - 0.04, 0.0, frame + height / 2.0),
        v(0.08, size.y, height),
        colour,
    );
    mesh.tapered(
        v(middle, 0.0, frame + 0.4 * wall),
        v(length * 0.95, size.y * 0.92, 0.8 * wall),
        0.4,
        0.4,
        solid(0.2),
    );
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
        for side in [-1.0, 1.0] {
            wheel(mesh, [x, side * (size.y / 2.0 - 0.22)], radius, 0.35);
        }
    }
}
