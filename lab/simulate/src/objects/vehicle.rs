//! Parts that motor vehicles share: wheels, seats, occupants, paint.

use super::super::mesh::{INTERIOR, METAL, Mesh, RETRO, RUBBER, SKIN, Surface, V3, solid, up, v};
use super::super::random::Dice;

/// Paint of a road vehicle: a third dark (which loses returns), the rest from grey to white.
pub(super) fn paint(dice: &mut Dice) -> Surface {
    let rhos = [[0.07, 0.13], [0.15, 0.35], [0.4, 0.75]];
    let [dark, light] = rhos[dice.weighted(&[0.22, 0.38, 0.4])];
    solid(dice.range(dark, light))
}

/// A wheel on each side, tyre and rim, `half_track` from the middle.
pub(super) fn axle(mesh: &mut Mesh, x: f32, half_track: f32, radius: f32, width: f32) {
    for side in [-1.0, 1.0] {
        let center = v(x, side * half_track, radius);
        let half = v(0.0, width / 2.0, 0.0);
        mesh.rod([center - half, center + half], radius, 10, RUBBER);
        let rim = v(0.0, width / 2.0 + 0.005, 0.0);
        mesh.rod([center - rim, center + rim], radius * 0.6, 7, METAL);
    }
}

/// A seat: cushion and leaning back, facing +x.
pub(super) fn seat(mesh: &mut Mesh, base: V3, width: f32) {
    mesh.block(base + up(0.07), v(0.45, width, 0.14), INTERIOR);
    let half = v(0.0, width / 2.0, 0.0);
    let (low, high) = (base + v(-0.22, 0.0, 0.1), base + v(-0.36, 0.0, 0.62));
    mesh.quad([low - half, low + half, high + half, high - half], INTERIOR);
}

/// A seated person, facing +x, on a seat whose cushion top is at `hip`.
pub(super) fn occupant(mesh: &mut Mesh, hip: V3, dice: &mut Dice) {
    let cloth = solid(dice.range(0.1, 0.6));
    let neck = hip + v(dice.range(-0.15, -0.02), 0.0, 0.52);
    mesh.tube([hip, neck], [0.16, 0.18], 6, cloth);
    let head = neck + v(0.03, 0.0, 0.2);
    mesh.blob(head, v(0.1, 0.08, 0.13), (3, 6), 0.0, dice, SKIN);
    for side in [-1.0, 1.0] {
        let knee = hip + v(0.42, side * 0.12, 0.06);
        let joint = hip + v(0.0, side * 0.1, 0.0);
        mesh.tube([joint, knee], [0.09, 0.07], 5, cloth);
        mesh.tube([knee, knee + v(0.08, 0.0, -0.42)], [0.06, 0.05], 5, cloth);
        let hand = hip + v(0.4, side * 0.15, 0.3);
        let shoulder = neck + v(0.0, side * 0.2, -0.05);
        mesh.tube([shoulder, hand], [0.05, 0.04], 4, cloth);
    }
}

/// Lamps and number plate on a face across x: retro-reflecting patches.
pub(super) fn plate_and_lamps(mesh: &mut Mesh, x: f32, z: f32, width: f32, outward: f32) {
    let mut patch = |y: f32, [w, h]: [f32; 2], back: f32, surface: Surface| {
        let center = v(x + outward * (0.01 - back), y, z);
        let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
        let place = |(i, j)| center + v(0.0, i * w / 2.0, j * h / 2.0);
        mesh.quad(corners.map(place), surface);
    };
    patch(0.0, [0.5, 0.11], 0.0, RETRO);
    for side in [-1.0, 1.0] {
        patch(side * width * 0.36, [0.22, 0.14], 0.12, solid(0.8));
    }
}
