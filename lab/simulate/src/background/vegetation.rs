//! Trees, bushes and rows of bushes: rough shells that part of the rays passes.

use super::super::mesh::{LEAVES, Mesh, Surface, V3, solid, up, v};
use super::super::random::Dice;
use super::{Family, Place, Thing, Yard, built};

const BARK: Surface = solid(0.25);

/// Bushes 6, rows of bushes 1 and trees 4 per 100 m, times a factor for the place (4.5 in gardens), at most 60 of each. A few large trees far behind.
pub(super) fn place(yard: &mut Yard, dice: &mut Dice) {
    let factor = match yard.ground.place {
        Place::Suburb => 4.5,
        Place::Urban => 2.4,
        Place::Industrial => 2.0,
        Place::Plaza => 1.4,
        Place::CarPark | Place::Depot | Place::Hall | Place::Path => 1.0,
    };
    let is_any = yard.layout.options.family == Family::SimAny;
    let factor = factor * if is_any { dice.range(0.6, 3.5) } else { 1.0 };
    for _ in 0..dice.events(6.0 * factor * yard.hundreds()) {
        let mesh = built(bush, dice);
        let (along, across) = (yard.somewhere(dice), yard.behind(12.0, dice));
        yard.put(Thing::Bush, &mesh, along, across, dice.spread(3.0));
    }
    for _ in 0..dice.events(1.2 * factor * yard.hundreds()) {
        let mesh = built(bush_row, dice);
        let (along, across) = (yard.somewhere(dice), yard.behind(9.0, dice));
        yard.put(Thing::Bush, &mesh, along, across, dice.normal(0.0, 0.1));
    }
    for _ in 0..dice.events(4.0 * factor * yard.hundreds()) {
        let along = yard.somewhere(dice);
        let across = yard.beside(0.4, 14.0, dice);
        tree(yard, along, across, dice.range(0.6, 1.1), dice);
    }
    for _ in 0..dice.whole(5, 14) {
        let along = yard.somewhere(dice);
        let across = dice.sign() * (yard.ground.edge_m + dice.range(16.0, 40.0));
        tree(yard, along, across, dice.range(1.0, 1.8), dice);
    }
}

/// A trunk that takes ground, and a crown that may be above other things.
pub(super) fn tree(yard: &mut Yard, along: f32, across: f32, scale: f32, dice: &mut Dice) {
    let radius = dice.range(0.1, 0.26) * scale;
    let is_any = yard.layout.options.family == Family::SimAny;
    let [low, high] = if is_any { [0.8, 4.5] } else { [1.7, 3.2] };
    let clear = dice.range(low, high) * scale.max(0.9);
    let lean = v(dice.spread(0.15), dice.spread(0.15), 0.0);
    let mut trunk = Mesh::default();
    let ends = [up(-0.3), lean + up(clear + 0.8)];
    trunk.tube(ends, [radius, radius * 0.75], 7, BARK);
    if !yard.put(Thing::Tree, &trunk, along, across, 0.0) {
        return;
    }
    let mut crown = Mesh::default();
    let spread = dice.range(1.1, 2.4) * scale;
    for _ in 0..dice.whole(2, 4) {
        let (dx, dy) = (dice.spread(spread * 0.5), dice.spread(spread * 0.5));
        let at = lean + v(dx, dy, clear + spread * dice.range(0.7, 1.6));
        let radii = spread * dice.size([0.7, 1.0], [0.7, 1.0], [0.6, 1.0]);
        crown.blob(at, radii, (5, 8), 0.25, dice, LEAVES);
    }
    for _ in 0..dice.whole(2, 4) {
        let (dx, dy) = (dice.spread(spread * 0.8), dice.spread(spread * 0.8));
        let tip = lean + v(dx, dy, clear + spread * dice.range(0.5, 1.5));
        crown.tube([lean + up(clear), tip], [radius * 0.5, 0.03], 4, BARK);
    }
    let (x, y) = yard.ground.sensor(along, across);
    yard.add(Thing::Tree, &crown, [x, y], 0.0);
}

fn clump(mesh: &mut Mesh, at: V3, radius: f32, dice: &mut Dice) {
    let radii = radius * dice.size([0.8, 1.2], [0.8, 1.2], [0.6, 1.1]);
    let center = at + up(radii.z * 0.75);
    mesh.blob(center, radii, (5, 9), 0.28, dice, LEAVES);
    mesh.blob(center, radii * 0.6, (3, 6), 0.3, dice, solid(0.3));
}

/// One bush of 0.5 to 2.5 m.
pub(super) fn bush(mesh: &mut Mesh, dice: &mut Dice) {
    let size = dice.range(0.25, 1.0);
    for _ in 0..dice.whole(1, 3) {
        let at = v(dice.spread(size * 0.7), dice.spread(size * 0.7), 0.0);
        clump(mesh, at, size * dice.range(0.6, 1.0), dice);
    }
}

/// Bushes in a row: as long as a car, sometimes longer.
fn bush_row(mesh: &mut Mesh, dice: &mut Dice) {
    for i in 0..dice.whole(3, 7) {
        let at = v(i as f32 * 1.1, dice.spread(0.25), 0.0);
        clump(mesh, at, dice.range(0.6, 0.95), dice);
    }
}

/// A strip of bushes and young trees, from the line y = 0 to +y.
pub(super) fn thicket(mesh: &mut Mesh, length: f32, dice: &mut Dice) {
    let depth = dice.range(1.5, 5.0);
    let height = dice.range(0.8, 1.7);
    let mut x = -length / 2.0 + 1.0;
    while x < length / 2.0 - 1.0 {
        let mut y = 1.0;
        while y < depth + 0.5 {
            let size = dice.range(0.55, 1.0) * height;
            let at = v(x + dice.spread(0.5), y + dice.spread(0.3), 0.0);
            clump(mesh, at, size, dice);
            if dice.chance(0.25) {
                let at = v(x, y, dice.range(2.2, 4.5));
                mesh.tube([v(x, y, 0.0), at], [0.07, 0.04], 5, BARK);
                let radii = dice.size([0.7, 1.4], [0.7, 1.4], [0.8, 1.8]);
                mesh.blob(at, radii, (4, 7), 0.3, dice, LEAVES);
            }
            y += dice.range(1.1, 1.9);
        }
        x += dice.range(0.9, 1.7);
    }
}
