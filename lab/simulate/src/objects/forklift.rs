//! Forklifts: counterweight, mast of two rails, overhead guard, forks, driver, often a pallet with a load.

use super::super::mesh::{METAL, Mesh, solid, up, v};
use super::vehicle::{axle, occupant, paint, seat};
use crate::{objects::Model, random::Dice};

/// A forklift; the forks and a carried load count as part of the object.
pub(super) fn forklift(dice: &mut Dice) -> Model {
    let body_length = dice.range(2.0, 2.6);
    let fork_length = dice.range(0.9, 1.2);
    let width = dice.range(1.12, 1.3);
    let height = dice.range(2.0, 2.3);
    let colour = paint(dice);
    let (front, half) = (body_length / 2.0, width / 2.0);
    let mut mesh = Mesh::default();
    let weight = v(0.7, width, 0.85);
    mesh.tapered(v(-front + 0.35, 0.0, 0.62), weight, [0.85, 0.9], colour);
    let body = v(body_length - 0.75, width * 0.9, 0.45);
    mesh.block(v(0.05, 0.0, 0.42), body, colour);
    let motor = v(0.9, width * 0.8, 0.35);
    mesh.tapered(v(-0.1, 0.0, 0.8), motor, [0.85, 0.8], solid(0.12));
    seat(&mut mesh, v(-0.1, 0.0, 0.92), 0.5);
    if dice.chance(0.75) {
        occupant(&mut mesh, v(-0.1, 0.0, 1.06), dice);
    }
    guard(&mut mesh, front, half, height);
    mast(&mut mesh, front, half, fork_length, dice);
    for (x, radius) in [(front - 0.4, 0.32), (-front + 0.4, 0.25)] {
        axle(&mut mesh, x, half - 0.12, radius, 0.24);
    }
    mesh.roughen(0.006, dice);
    let (low, high) = mesh.bounds();
    let middle = (low + high) / 2.0;
    mesh.map(|p| v(p.x - middle.x, p.y - middle.y, (p.z - low.z).max(0.0)));
    Model::new(mesh)
}

/// Four posts and a slatted roof.
fn guard(mesh: &mut Mesh, front: f32, half: f32, height: f32) {
    let (fore, aft, black) = (front - 0.55, -front + 0.55, solid(0.12));
    for side in [-1.0, 1.0] {
        let y = side * half * 0.85;
        let top = |x: f32| v(x, y, height - 0.05);
        mesh.strut(v(front - 0.35, y, 0.6), top(fore - 0.1), 0.035, black);
        mesh.strut(v(aft - 0.1, y, 0.9), top(aft + 0.05), 0.035, black);
        let rail = v((fore + aft) / 2.0, y, height - 0.04);
        mesh.block(rail, v(fore - aft, 0.08, 0.08), black);
    }
    for i in 0..6 {
        let x = aft + (fore - aft) * (i as f32 + 0.5) / 6.0;
        let slat = v(0.06, half * 1.7, 0.05);
        mesh.block(v(x, 0.0, height - 0.04), slat, black);
    }
}

fn mast(mesh: &mut Mesh, front: f32, half: f32, fork_length: f32, dice: &mut Dice) {
    let top = dice.range(1.95, 2.35);
    let is_low = dice.chance(0.5);
    let [low, high] = if is_low { [0.05, 0.2] } else { [0.2, 1.3] };
    let lift = dice.range(low, high);
    let fork_x = front + 0.14 + fork_length / 2.0;
    for side in [-1.0, 1.0] {
        let rail = v(front + 0.02, side * half * 0.45, (top + 0.1) / 2.0);
        mesh.block(rail, v(0.14, 0.1, top - 0.1), METAL);
        let y = side * half * 0.38;
        let fork = v(fork_length, 0.12, 0.05);
        mesh.block(v(fork_x, y, lift + 0.03), fork, METAL);
        mesh.block(v(front + 0.12, y, lift + 0.3), v(0.06, 0.12, 0.6), METAL);
    }
    for z in [0.35, 0.5 * top, top - 0.06] {
        mesh.block(v(front + 0.02, 0.0, z), v(0.08, half * 0.9, 0.09), METAL);
    }
    let carriage = v(0.05, half * 1.2, 0.08);
    mesh.block(v(front + 0.12, 0.0, lift + 0.35), carriage, METAL);
    if dice.chance(0.4) {
        let center = v(front + 0.16 + fork_length / 2.0, 0.0, lift + 0.12);
        let pallet = v(fork_length.min(1.1), half * 1.9, 0.13);
        mesh.block(center, pallet, solid(0.4));
        let h = dice.range(0.3, 1.0);
        let load = v(0.95, half * 1.75, h);
        let at = center + up(0.065 + h / 2.0);
        mesh.block(at, load, solid(dice.range(0.2, 0.6)));
    }
}
