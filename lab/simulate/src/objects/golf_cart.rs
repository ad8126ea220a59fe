//! Golf carts: low cowl, small wheels, open sides, benches, four thin pillars under a roof slab, up to four people.

use super::super::mesh::{GLASS, Mesh, Surface, V3, solid, v};
use super::vehicle::{axle, occupant, paint, seat};
use crate::{objects::Model, random::Dice};

/// A golf cart with one or two benches.
pub(super) fn golf_cart(dice: &mut Dice) -> Model {
    let two_rows = dice.chance(0.4);
    let length_m = if two_rows { [2.9, 3.5] } else { [2.35, 2.75] };
    let size = dice.size(length_m, [1.18, 1.34], [1.76, 2.0]);
    let colour = paint(dice);
    let (front, half) = (size.x / 2.0, size.y / 2.0);
    let mut mesh = Mesh::default();
    let floor = v(size.x * 0.94, size.y * 0.86, 0.14);
    mesh.block(v(0.0, 0.0, 0.28), floor, solid(0.15));
    let cowl = v(0.6, size.y * 0.92, 0.5);
    mesh.tapered(v(front - 0.3, 0.0, 0.58), cowl, [0.55, 0.9], colour);
    let tail = v(0.8, size.y * 0.96, 0.42);
    mesh.tapered(v(-front + 0.4, 0.0, 0.55), tail, [0.9, 0.92], colour);
    benches(&mut mesh, two_rows, front, half, dice);
    roof(&mut mesh, size, colour, dice);
    for x in [front - 0.42, -front + 0.5] {
        axle(&mut mesh, x, half - 0.1, 0.22, 0.19);
    }
    // Steering column and wheel.
    let at = |back: f32, z: f32| v(front - back, half * 0.45, z);
    mesh.strut(at(0.6, 0.7), at(0.85, 0.98), 0.025, solid(0.1));
    mesh.rod([at(0.84, 0.96), at(0.87, 0.99)], 0.17, 7, solid(0.1));
    if dice.chance(0.35) {
        // Golf bag or tools on the rear shelf.
        let bag = v(-front + 0.2, dice.spread(0.2), 0.95);
        mesh.block(bag, v(0.3, 0.6, 0.6), solid(dice.range(0.1, 0.5)));
    }
    mesh.roughen(0.006, dice);
    mesh.fit(size);
    Model::new(mesh)
}

fn benches(mesh: &mut Mesh, two_rows: bool, front: f32, half: f32, dice: &mut Dice) {
    for row in 0..=u8::from(two_rows) {
        let x = front - 1.25 - f32::from(row) * 0.85;
        seat(mesh, v(x, 0.0, 0.6), half * 1.7);
        for side in [1.0, -1.0] {
            let is_driver = row == 0 && side > 0.0;
            if dice.chance(if is_driver { 0.7 } else { 0.35 }) {
                occupant(mesh, v(x, side * half * 0.45, 0.75), dice);
            }
        }
    }
}

fn roof(mesh: &mut Mesh, size: V3, colour: Surface, dice: &mut Dice) {
    let (front, half) = (size.x / 2.0, size.y / 2.0);
    let (fore, aft) = (front - 0.5, -front + 0.25);
    for side in [-1.0, 1.0] {
        let y = side * half * 0.86;
        for (foot, top) in [(front - 0.2, fore - 0.12), (aft, aft + 0.05)] {
            let top = v(top, y * 0.95, size.z - 0.06);
            mesh.strut(v(foot, y, 0.75), top, 0.022, solid(0.1));
        }
    }
    let slab = v(fore - aft + 0.3, half * 2.0 * 0.98, 0.08);
    let center = v((fore + aft) / 2.0 - 0.05, 0.0, size.z - 0.04);
    mesh.tapered(center, slab, [0.93, 0.9], colour);
    if dice.chance(0.6) {
        let low = |y: f32| v(front - 0.22, y * half, 0.85);
        let high = |y: f32| v(fore - 0.1, y * half, size.z - 0.1);
        mesh.quad([low(-0.82), low(0.82), high(0.8), high(-0.8)], GLASS);
    }
}
