//! Pedestrians: walking or standing, sometimes bent, with a bag, an umbrella or a stroller.

use super::super::mesh::{METAL, Mesh, RUBBER, SKIN, Surface, circle, solid, v};
use crate::{Family, objects::Model, random::Dice};

/// A person of 1.76 m on average, in any phase of the step.
pub(super) fn pedestrian(family: Family, dice: &mut Dice) -> Model {
    let is_any = family == Family::SimAny;
    let is_child = dice.chance(if is_any { 0.12 } else { 0.06 });
    let height = if is_child { dice.range(1.15, 1.45) } else { dice.normal(1.78, 0.085) };
    let s = height / 1.76;
    let walks = dice.chance(0.8);
    let [short, long] = if walks { [0.3, 0.66] } else { [0.0, 0.1] };
    let stride = dice.range(short, long);
    let phase = dice.sign() * dice.range(0.3, 1.0);
    let swing = stride * phase;
    let coat = solid(dice.range(0.08, 0.7));
    let trousers = solid(dice.range(0.08, 0.4));
    let girth = dice.range(0.9, if is_any { 1.4 } else { 1.2 });
    let mut mesh = Mesh::default();
    legs(&mut mesh, swing, dice.range(0.07, 0.13), trousers);
    let lean = 0.06 * stride + dice.range(-0.01, 0.04);
    torso(&mut mesh, girth, lean, coat);
    arms(&mut mesh, swing, lean, girth, coat, dice);
    let head = v(0.03 + lean, 0.0, 1.62);
    mesh.blob(head, v(0.115, 0.085, 0.14), (4, 7), 0.05, dice, SKIN);
    if dice.chance(0.3) {
        // Rucksack.
        mesh.block(v(-0.22 * girth, 0.0, 1.22), v(0.2, 0.3, 0.45), coat);
    }
    if dice.chance(0.22) {
        // Bag in the hand.
        mesh.block(v(-swing * 0.5, 0.34, 0.5), v(0.3, 0.12, 0.32), trousers);
    }
    if is_any {
        carriage(&mut mesh, swing, trousers, dice);
    }
    mesh.map(|p| p * s);
    rare_things(&mut mesh, s, dice);
    mesh.roughen(0.006, dice);
    mesh.put_down();
    Model::new(mesh)
}

fn legs(mesh: &mut Mesh, swing: f32, spacing: f32, trousers: Surface) {
    for side in [-1.0, 1.0] {
        let foot_x = side * swing;
        let hip = v(0.0, side * 0.09, 0.9);
        // The rear foot's heel lifts and its knee bends.
        let lift = 0.35 * (-foot_x).max(0.0);
        let ankle = v(foot_x, side * spacing, 0.08 + lift);
        let knee = (hip + ankle) / 2.0 + v(0.05 + 0.12 * foot_x.abs(), 0.0, 0.0);
        mesh.tube([hip, knee], [0.098, 0.07], 6, trousers);
        mesh.tube([knee, ankle], [0.068, 0.05], 6, trousers);
        mesh.block(ankle + v(0.06, 0.0, -0.04), v(0.26, 0.095, 0.08), RUBBER);
    }
}

fn torso(mesh: &mut Mesh, girth: f32, lean: f32, coat: Surface) {
    let levels = [
        [0.80, 0.0, 0.12, 0.17],
        [0.98, 0.0, 0.125, 0.165],
        [1.15, lean * 0.5, 0.12, 0.16],
        [1.32, lean * 0.8, 0.13, 0.19],
        [1.44, lean, 0.10, 0.20],
        [1.50, lean, 0.06, 0.08],
    ];
    let wide = levels.map(|[z, x, rx, ry]| [z, x, rx * girth, ry * girth]);
    mesh.stack(wide, coat);
}

fn arms(mesh: &mut Mesh, swing: f32, lean: f32, girth: f32, coat: Surface, dice: &mut Dice) {
    for side in [-1.0, 1.0] {
        let shoulder = v(lean, side * 0.2 * girth, 1.4);
        let hanging_x = -side * swing * 0.85 + 0.03;
        let hand = match dice.weighted(&[0.8, 0.1, 0.1]) {
            0 => v(hanging_x, side * (0.22 * girth + 0.02), 0.84),
            1 => v(0.28, side * 0.1, 1.12),
            _ => v(0.2, side * 0.2, 1.45),
        };
        let elbow = (shoulder + hand) / 2.0 + v(-0.05, side * 0.04, 0.0);
        mesh.tube([shoulder, elbow], [0.062, 0.05], 5, coat);
        mesh.tube([elbow, hand], [0.048, 0.035], 5, coat);
        mesh.block(hand + v(0.02, 0.0, -0.04), v(0.07, 0.05, 0.14), SKIN);
    }
}

/// Skirts and long coats 20 %, a suitcase 5 %; one person of eight bends from the hip.
fn carriage(mesh: &mut Mesh, swing: f32, cloth: Surface, dice: &mut Dice) {
    if dice.chance(0.2) {
        let (hem, half) = (dice.range(0.15, 0.6), dice.range(0.16, 0.26));
        let low = [hem, 0.0, half + 0.4 * swing.abs(), half];
        mesh.stack([low, [1.0, 0.0, 0.13, 0.17]], cloth);
    }
    if dice.chance(0.05) {
        let case = dice.size([0.2, 0.35], [0.35, 0.5], [0.5, 0.75]);
        mesh.block(v(-0.55, 0.25, case.z / 2.0 + 0.05), case, cloth);
        mesh.strut(v(-0.5, 0.25, case.z), v(-0.15, 0.3, 0.85), 0.015, METAL);
    }
    if dice.chance(0.125) {
        let bend = dice.range(0.2, 1.3);
        mesh.map(|p| {
            let above = (p.z - 0.9).max(0.0);
            let (sin, cos) = (bend * (above / 0.3).min(1.0)).sin_cos();
            let z = p.z - above + above * cos - p.x * sin;
            v(p.x * cos + above * sin, p.y, z)
        });
    }
}

/// Umbrella 2 %, stroller 3 %.
fn rare_things(mesh: &mut Mesh, scale: f32, dice: &mut Dice) {
    let chance = dice.unit();
    if chance < 0.02 {
        let top = v(0.15, 0.1, 1.95 * scale);
        mesh.strut(v(0.25, 0.15, 1.1 * scale), top, 0.012, METAL);
        let rim = circle(8, 0.0, |c, s| top + v(0.45 * c, 0.45 * s, -0.14));
        mesh.loft(&[rim, vec![top; 8]], true, |_, _| solid(0.2));
    } else if chance < 0.05 {
        let basket = v(0.7, 0.45, 0.4);
        mesh.tapered(v(0.75, 0.0, 0.62), basket, [1.15, 1.0], solid(0.2));
        for (x, y) in [(0.5, 0.2), (0.5, -0.2), (1.0, 0.2), (1.0, -0.2)] {
            mesh.rod([v(x, y - 0.02, 0.1), v(x, y + 0.02, 0.1)], 0.1, 6, RUBBER);
            mesh.strut(v(x, y, 0.1), v(0.75, y, 0.45), 0.015, METAL);
        }
        for y in [0.2, -0.2] {
            mesh.strut(v(0.4, y, 0.8), v(0.25, y, 1.05), 0.015, METAL);
        }
    }
}
