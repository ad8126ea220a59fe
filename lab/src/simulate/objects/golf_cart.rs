//! Golf carts: low cowl, small wheels, open sides, benches, four thin pillars under a roof slab, up to four people.

use super::super::mesh::{GLASS, Mesh, Surface, solid, v};
use super::super::random::Dice;
use super::vehicle::{occupant, paint, seat, wheel};
use super::{Model, fit};

/// A golf cart with one or two benches.
pub(super) fn golf_cart(dice: &mut Dice) -> Model {
    let two_rows = dice.chance(0.4);
    let size = v(
        if two_rows {
            dice.range(2.9, 3.5)
        } else {
            dice.range(2.35, 2.75)
        },
        dice.range(1.18, 1.34),
        dice.range(1.76, 2.0),
    );
    let colour = paint(dice);
    let front = size.x / 2.0;
    let half = size.y / 2.0;
    let mut mesh = Mesh::default();
    mesh.block(
        v(0.0, 0.0, 0.28),
        v(size.x * 0.94, size.y * 0.86, 0.14),
        solid(0.15),
    );
    mesh.tapered(
        v(front - 0.3, 0.0, 0.58),
        v(0.6, size.y * 0.92, 0.5),
        0.55,
        0.9,
        colour,
    );
    mesh.tapered(
        v(-front + 0.4, 0.0, 0.55),
        v(0.8, size.y * 0.96, 0.42),
        0.9,
        0.92,
        colour,
    );
    benches(&mut mesh, two_rows, front, half, dice);
    roof(&mut mesh, front, half, size.z, colour, dice);
    for x in [front - 0.42, -front + 0.5] {
        for side in [-1.0, 1.0] {
            wheel(&mut mesh, [x, side * (half - 0.1)], 0.22, 0.19);
        }
    }
    // Steering column and wheel.
    mesh.strut(
        v(front - 0.6, half * 0.45, 0.7),
        v(front - 0.85, half * 0.45, 0.98),
        0.025,
        solid(0.1),
    );
    mesh.tube(
        [
            v(front - 0.84, half * 0.45, 0.96),
            v(front - 0.87, half * 0.45, 0.99),
        ],
        [0.17, 0.17],
        7,
        solid(0.1),
    );
    if dice.chance(0.35) {
        // Golf bag or tools on the rear shelf.
        mesh.block(
            v(-front + 0.2, dice.spread(0.2), 0.95),
            v(0.3, 0.6, 0.6),
            solid(dice.range(0.1, 0.5)),
        );
    }
    mesh.roughen(0.006, dice);
    fit(&mut mesh, size);
    Model::new(mesh, &Mesh::default())
}

fn benches(mesh: &mut Mesh, two_rows: bool, front: f32, half: f32, dice: &mut Dice) {
    let first = front - 1.25;
    let rows = if two_rows { 2 } else { 1 };
    for row in 0..rows {
        let x = first - row as f32 * 0.85;
        seat(mesh, v(x, 0.0, 0.6), half * 1.7);
        for side in [1.0, -1.0] {
            let driver = row == 0 && side > 0.0;
            if dice.chance(if driver { 0.7 } else { 0.35 }) {
                occupant(mesh, v(x, side * half * 0.45, 0.75), dice);
            }
        }
    }
}

fn roof(mesh: &mut Mesh, front: f32, half: f32, height: f32, colour: Surface, dice: &mut Dice) {
    let (fore, aft) = (front - 0.5, -front + 0.25);
    for side in [-1.0, 1.0] {
        let y = side * half * 0.86;
        mesh.strut(
            v(front - 0.2, y, 0.75),
            v(fore - 0.12, y * 0.95, height - 0.06),
            0.022,
            solid(0.1),
        );
        mesh.strut(
            v(aft, y, 0.75),
            v(aft + 0.05, y * 0.95, height - 0.06),
            0.022,
            solid(0.1),
        );
    }
    let length = fore - aft + 0.3;
    mesh.tapered(
        v((fore + aft) / 2.0 - 0.05, 0.0, height - 0.04),
        v(length, half * 2.0 * 0.98, 0.08),
        0.93,
        0.9,
        colour,
    );
    if dice.chance(0.6) {
        mesh.quad(
            [
                v(front - 0.22, -half * 0.82, 0.85),
                v(front - 0.22, half * 0.82, 0.85),
                v(fore - 0.1, half * 0.8, height - 0.1),
                v(fore - 0.1, -half * 0.8, height - 0.1),
            ],
            GLASS,
        );
    }
}
