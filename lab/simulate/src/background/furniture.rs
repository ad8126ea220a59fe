//! Street furniture, at rates per 100 m of road.

use super::super::mesh::{GLASS, LEAVES, METAL, Mesh, RETRO, RUBBER, solid, up, v};
use super::super::{objects::bicycle, random::Dice};
use super::{Builder, Thing, Yard, built};

/// Kind, builder, and number per 100 m (towns, industry).
const CATALOGUE: [(Thing, Builder, [f32; 2]); 10] = [
    (Thing::Pole, pole, [9.0, 7.5]),
    (Thing::Sign, sign, [7.5, 3.8]),
    (Thing::Bollard, bollards, [2.2, 3.8]),
    (Thing::Hydrant, hydrant, [2.2, 1.5]),
    (Thing::Bin, bin, [4.5, 3.0]),
    (Thing::Bench, bench, [1.8, 1.2]),
    (Thing::Bicycles, bicycles, [2.0, 0.9]),
    (Thing::Shelter, shelter, [0.6, 0.2]),
    (Thing::Planter, planter, [2.2, 1.5]),
    (Thing::Sign, barrier, [1.2, 1.8]),
];

/// Places the things of the catalogue.
pub(super) fn place(yard: &mut Yard, dice: &mut Dice) {
    for (thing, build, rates) in CATALOGUE {
        for _ in 0..dice.events(rates[yard.column()] * yard.hundreds()) {
            let mesh = built(build, dice);
            let along = yard.somewhere(dice);
            let across = yard.beside(0.65, 6.0, dice);
            let yaw = std::f32::consts::FRAC_PI_2 * dice.whole(0, 3) as f32 + dice.normal(0.0, 0.1);
            yard.put(thing, &mesh, along, across, yaw);
        }
    }
}

pub(super) fn pole(mesh: &mut Mesh, dice: &mut Dice) {
    let (height, radius) = (dice.range(4.0, 8.5), dice.range(0.06, 0.14));
    mesh.tube([up(-0.2), up(height)], [radius, radius * 0.7], 7, METAL);
    if dice.chance(0.6) {
        // The arm hangs over the road; it is narrow and takes no ground.
        let tip = v(0.9, 0.0, height + 0.2);
        mesh.strut(up(height - 0.1), tip, 0.04, METAL);
        mesh.block(v(1.0, 0.0, height + 0.18), v(0.5, 0.2, 0.12), METAL);
    } else if dice.chance(0.4) {
        mesh.block(v(0.12, 0.0, 3.2), v(0.25, 0.3, 0.9), solid(0.1));
    }
}

pub(super) fn sign(mesh: &mut Mesh, dice: &mut Dice) {
    let height = dice.range(2.0, 2.6);
    mesh.rod([up(-0.1), up(height + 0.3)], 0.035, 6, METAL);
    let half = dice.range(0.25, 0.4);
    mesh.block(v(0.04, 0.0, height), v(0.02, 2.0 * half, 2.0 * half), RETRO);
}

fn bollards(mesh: &mut Mesh, dice: &mut Dice) {
    let (height, radius) = (dice.range(0.6, 1.15), dice.range(0.06, 0.15));
    for i in 0..dice.whole(1, 4) {
        let ends = [0.0, height].map(|z| v(i as f32 * 1.5, 0.0, z));
        mesh.tube(ends, [radius, radius * 0.85], 8, solid(0.3));
    }
}

fn hydrant(mesh: &mut Mesh, dice: &mut Dice) {
    let height = dice.range(0.6, 0.95);
    let heights = [0.0, 0.1, 0.8 * height, height];
    let radii = [0.16, 0.11, 0.11, 0.04];
    let levels = [0, 1, 2, 3].map(|i| [heights[i], 0.0, radii[i], radii[i]]);
    mesh.stack(levels, solid(0.4));
    mesh.block(up(height * 0.6), v(0.12, 0.4, 0.12), solid(0.4));
}

pub(super) fn bin(mesh: &mut Mesh, dice: &mut Dice) {
    let paint = solid(dice.range(0.1, 0.4));
    for i in 0..dice.whole(1, 3) {
        let at = v(0.0, i as f32 * 0.75, 0.52);
        mesh.tapered(at, v(0.6, 0.52, 0.95), [1.15, 1.1], paint);
        mesh.tapered(at + up(0.52), v(0.72, 0.6, 0.09), [0.85, 0.9], paint);
        let axle = [at.y - 0.25, at.y + 0.25].map(|y| v(-0.25, y, 0.1));
        mesh.rod(axle, 0.1, 6, RUBBER);
    }
}

pub(super) fn bench(mesh: &mut Mesh, dice: &mut Dice) {
    let wood = solid(dice.range(0.25, 0.45));
    for i in 0..3 {
        let at = v(-0.15 + 0.15 * i as f32, 0.0, 0.45);
        mesh.block(at, v(0.12, 1.6, 0.05), wood);
    }
    let [low, high] = [(-0.25, 0.55), (-0.38, 0.88)].map(|(x, z)| move |y: f32| v(x, y, z));
    mesh.quad([low(-0.8), low(0.8), high(0.8), high(-0.8)], wood);
    for y in [-0.65, 0.65] {
        mesh.block(v(0.0, y, 0.22), v(0.4, 0.07, 0.42), METAL);
    }
}

pub(super) fn bicycles(mesh: &mut Mesh, dice: &mut Dice) {
    for i in 0..dice.whole(1, 6) {
        let one = built(bicycle, dice);
        let lean = dice.normal(0.0, 0.12);
        let y = i as f32 * 0.55;
        mesh.add(&one, |p| v(p.x, p.y + lean * p.z + y, p.z));
    }
}

pub(super) fn shelter(mesh: &mut Mesh, _: &mut Dice) {
    mesh.block(up(2.4), v(1.6, 4.0, 0.12), METAL);
    let pane = [(-1.95, 0.1), (1.95, 0.1), (1.95, 2.3), (-1.95, 2.3)];
    mesh.quad(pane.map(|(y, z)| v(-0.75, y, z)), GLASS);
    for y in [-1.95, 1.95] {
        mesh.block(v(-0.75, y, 1.2), v(0.08, 0.08, 2.4), METAL);
        mesh.block(v(0.6, y, 1.2), v(0.08, 0.08, 2.4), METAL);
    }
    mesh.block(v(-0.45, 0.0, 0.45), v(0.4, 2.4, 0.06), solid(0.4));
}

fn planter(mesh: &mut Mesh, dice: &mut Dice) {
    let size = dice.size([0.8, 2.0], [0.6, 1.0], [0.4, 0.7]);
    mesh.tapered(up(size.z / 2.0), size, [1.1, 1.1], solid(0.4));
    let plant = v(size.x * 0.45, size.y * 0.45, dice.range(0.3, 0.8));
    mesh.blob(up(size.z + 0.15), plant, (4, 8), 0.3, dice, LEAVES);
}

/// A barrier of road works: boards on feet.
fn barrier(mesh: &mut Mesh, dice: &mut Dice) {
    let length = dice.range(1.2, 3.0);
    for z in [0.5, 0.95] {
        mesh.block(up(z), v(0.04, length, 0.2), solid(0.8));
    }
    for side in [-0.4, 0.4] {
        mesh.block(v(0.0, side * length, 0.5), v(0.06, 0.06, 1.0), METAL);
        mesh.block(v(0.0, side * length, 0.05), v(0.6, 0.25, 0.1), RUBBER);
    }
}
