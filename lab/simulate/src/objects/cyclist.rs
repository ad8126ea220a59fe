//! Cyclists: a frame of thin tubes, two wheels with spokes, a leaning rider.

use super::super::mesh::{
    METAL, Mesh, RETRO, RUBBER, SKIN, Surface, V3, circle, porous, solid, up, v,
};
use crate::{objects::Model, random::Dice};

/// A rider on a bicycle.
pub(super) fn cyclist(dice: &mut Dice) -> Model {
    let (length, width) = (dice.normal(1.77, 0.14), dice.normal(0.6, 0.09).max(0.42));
    let size = v(length, width, dice.normal(1.735, 0.1));
    let mut mesh = Mesh::default();
    bicycle(&mut mesh, dice);
    rider(&mut mesh, dice);
    mesh.fit(size);
    mesh.roughen(0.005, dice);
    mesh.put_down();
    Model::new(mesh)
}

/// An upright bicycle, its middle above the origin; also used for parked bicycles.
pub(crate) fn bicycle(mesh: &mut Mesh, dice: &mut Dice) {
    let frame = solid(dice.range(0.1, 0.5));
    let radius = dice.range(0.32, 0.35);
    let half_base = dice.range(0.5, 0.55);
    let [front, rear] = [half_base, -half_base].map(|x| v(x, 0.0, radius));
    wheel(mesh, front, radius);
    wheel(mesh, rear, radius);
    let crank = v(-0.05, 0.0, 0.3);
    let saddle = v(-0.22, 0.0, 0.95);
    let head = v(0.38, 0.0, 0.88);
    mesh.strut(rear, crank, 0.025, frame);
    mesh.strut(rear, saddle, 0.025, frame);
    mesh.strut(crank, saddle, 0.025, frame);
    mesh.strut(crank, head, 0.025, frame);
    mesh.strut(saddle - up(0.18), head, 0.025, frame);
    mesh.strut(front, head, 0.025, frame);
    mesh.strut(head, head + v(-0.04, 0.0, 0.15), 0.02, frame);
    let (bar, half) = (head + v(-0.02, 0.0, 0.16), v(0.0, 0.29, 0.0));
    mesh.strut(bar - half, bar + half, 0.018, METAL);
    mesh.block(saddle, v(0.26, 0.14, 0.07), RUBBER);
    mesh.block(v(-half_base - 0.1, 0.0, 0.7), v(0.03, 0.08, 0.08), RETRO);
    if dice.chance(0.35) {
        mesh.block(v(-half_base, 0.0, 0.76), v(0.36, 0.26, 0.12), METAL);
    }
}

/// Tyre ring and a disc of spokes.
pub(super) fn wheel(mesh: &mut Mesh, hub: V3, radius: f32) {
    let ring = |r: f32, y: f32| circle(12, 0.0, |c, s| hub + v(r * c, y, r * s));
    let inner = radius - 0.05;
    let rings = [ring(inner, -0.02), ring(radius, 0.0), ring(inner, 0.02)];
    mesh.loft(&rings, true, |_, _| RUBBER);
    mesh.cap(&ring(inner, 0.0), porous(0.3, 0.8));
}

fn rider(mesh: &mut Mesh, dice: &mut Dice) {
    let coat = solid(dice.range(0.08, 0.7));
    let trousers = solid(dice.range(0.08, 0.4));
    let lean = dice.range(0.1, 0.42);
    let hip = v(-0.22, 0.0, 1.0);
    let shoulder = hip + v(0.58 * lean.sin() + 0.08, 0.0, 0.55 * lean.cos());
    let waist = (hip + shoulder) / 2.0;
    mesh.tube([hip - up(0.06), waist], [0.16, 0.165], 7, coat);
    mesh.tube([waist, shoulder], [0.165, 0.15], 7, coat);
    let head = shoulder + v(0.07, 0.0, 0.22);
    mesh.blob(head, v(0.12, 0.09, 0.14), (4, 7), 0.04, dice, SKIN);
    legs(mesh, hip, trousers, dice);
    for side in [-1.0, 1.0] {
        let from = shoulder + v(0.0, side * 0.19, -0.04);
        let hand = v(0.36, side * 0.26, 1.04);
        let elbow = (from + hand) / 2.0 + v(-0.02, side * 0.05, -0.05);
        mesh.tube([from, elbow], [0.06, 0.05], 5, coat);
        mesh.tube([elbow, hand], [0.05, 0.035], 5, coat);
    }
    if dice.chance(0.3) {
        let rucksack = waist + v(-0.24, 0.0, 0.08);
        mesh.block(rucksack, v(0.2, 0.3, 0.4), trousers);
    }
}

fn legs(mesh: &mut Mesh, hip: V3, trousers: Surface, dice: &mut Dice) {
    let turn = dice.range(0.0, std::f32::consts::TAU);
    for (side, half_turn) in [(-1.0, std::f32::consts::PI), (1.0, 0.0)] {
        let (sin, cos) = ((turn + half_turn).sin(), (turn + half_turn).cos());
        let foot = v(-0.05 + 0.17 * cos, side * 0.12, 0.3 + 0.17 * sin);
        let knee = (hip + foot) / 2.0 + v(0.2, side * 0.04, 0.06);
        let joint = hip + v(0.0, side * 0.08, 0.0);
        mesh.tube([joint, knee], [0.09, 0.07], 6, trousers);
        mesh.tube([knee, foot], [0.065, 0.045], 6, trousers);
        mesh.block(foot + v(0.05, 0.0, -0.03), v(0.26, 0.09, 0.08), RUBBER);
    }
}
