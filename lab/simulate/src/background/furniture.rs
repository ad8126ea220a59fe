//! Street furniture, at rates per 100 m of road.

use super::super::mesh::{GLASS, METAL, Mesh, RETRO, RUBBER, solid, v};
use super::super::objects::bicycle;
use super::super::random::Dice;
use super::vegetation::LEAVES;
use super::{Place, Thing, Yard};

type Builder = fn(&mut Dice) -> Mesh;

/// Kind, how it is built, and how many stand along 100 m (towns, industry).
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

/// Places the catalogue.
pub(super) fn place(yard: &mut Yard<'_, '_>, dice: &mut Dice) {
    let column = usize::from(yard.is(Place::Industrial) || yard.is(Place::Plaza));
    for (thing, build, rates) in CATALOGUE {
        for _ in 0..dice.events(rates[column] * yard.hundreds()) {
            let mesh = build(dice);
            let along = yard.somewhere(dice);
            let across = if dice.chance(0.65) {
                yard.on_pavement(dice)
            } else {
                yard.behind(6.0, dice)
            };
            let yaw = std::f32::consts::FRAC_PI_2 * dice.whole(0, 3) as f32 + dice.normal(0.0, 0.1);
            yard.put(thing, &mesh, along, across, yaw);
        }
    }
}

fn pole(dice: &mut Dice) -> Mesh {
    let (height, radius) = (dice.range(4.0, 8.5), dice.range(0.06, 0.14));
    let mut mesh = Mesh::default();
    let ends = [v(0.0, 0.0, -0.2), v(0.0, 0.0, height)];
    mesh.tube(ends, [radius, radius * 0.7], 7, METAL);
    if dice.chance(0.6) {
        // The arm hangs over the road; it does not count as ground that is taken, being narrow.
        mesh.strut(
            v(0.0, 0.0, height - 0.1),
            v(0.9, 0.0, height + 0.2),
            0.04,
            METAL,
        );
        mesh.block(v(1.0, 0.0, height + 0.18), v(0.5, 0.2, 0.12), METAL);
    } else if dice.chance(0.4) {
        mesh.block(v(0.12, 0.0, 3.2), v(0.25, 0.3, 0.9), solid(0.1));
    }
    mesh
}

fn sign(dice: &mut Dice) -> Mesh {
    let height = dice.range(2.0, 2.6);
    let mut mesh = Mesh::default();
    mesh.rod(
        [v(0.0, 0.0, -0.1), v(0.0, 0.0, height + 0.3)],
        0.035,
        6,
        METAL,
    );
    let half = dice.range(0.25, 0.4);
    mesh.block(v(0.04, 0.0, height), v(0.02, 2.0 * half, 2.0 * half), RETRO);
    mesh
}

fn bollards(dice: &mut Dice) -> Mesh {
    let mut mesh = Mesh::default();
    let (height, radius) = (dice.range(0.6, 1.15), dice.range(0.06, 0.15));
    for i in 0..dice.whole(1, 4) {
        let x = i as f32 * 1.5;
        let ends = [v(x, 0.0, 0.0), v(x, 0.0, height)];
        mesh.tube(ends, [radius, radius * 0.85], 8, solid(0.3));
    }
    mesh
}

fn hydrant(dice: &mut Dice) -> Mesh {
    let mut mesh = Mesh::default();
    let height = dice.range(0.6, 0.95);
    let levels = [
        (0.0, 0.16),
        (0.1, 0.11),
        (height * 0.8, 0.11),
        (height, 0.04),
    ];
    mesh.stack(&levels.map(|(z, r)| [z, 0.0, r, r]), 8, solid(0.4));
    mesh.block(v(0.0, 0.0, height * 0.6), v(0.12, 0.4, 0.12), solid(0.4));
    mesh
}

fn bin(dice: &mut Dice) -> Mesh {
    let mut mesh = Mesh::default();
    let paint = solid(dice.range(0.1, 0.4));
    for i in 0..dice.whole(1, 3) {
        let at = v(0.0, i as f32 * 0.75, 0.52);
        mesh.tapered(at, v(0.6, 0.52, 0.95), 1.15, 1.1, paint);
        mesh.tapered(at + v(0.0, 0.0, 0.52), v(0.72, 0.6, 0.09), 0.85, 0.9, paint);
        let axle = [at.y - 0.25, at.y + 0.25].map(|y| v(-0.25, y, 0.1));
        mesh.rod(axle, 0.1, 6, RUBBER);
    }
    mesh
}

fn bench(dice: &mut Dice) -> Mesh {
    let mut mesh = Mesh::default();
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
    mesh
}

fn bicycles(dice: &mut Dice) -> Mesh {
    let mut mesh = Mesh::default();
    for i in 0..dice.whole(1, 6) {
        let mut one = Mesh::default();
        bicycle(&mut one, dice);
        let lean = dice.normal(0.0, 0.12);
        let y = i as f32 * 0.55;
        mesh.add(&one, |p| v(p.x, p.y + lean * p.z + y, p.z));
    }
    mesh
}

fn shelter(_: &mut Dice) -> Mesh {
    let mut mesh = Mesh::default();
    mesh.block(v(0.0, 0.0, 2.4), v(1.6, 4.0, 0.12), METAL);
    let at = |y: f32, z: f32| v(-0.75, y, z);
    mesh.quad(
        [at(-1.95, 0.1), at(1.95, 0.1), at(1.95, 2.3), at(-1.95, 2.3)],
        GLASS,
    );
    for y in [-1.95, 1.95] {
        mesh.block(v(-0.75, y, 1.2), v(0.08, 0.08, 2.4), METAL);
        mesh.block(v(0.6, y, 1.2), v(0.08, 0.08, 2.4), METAL);
    }
    mesh.block(v(-0.45, 0.0, 0.45), v(0.4, 2.4, 0.06), solid(0.4));
    mesh
}

fn planter(dice: &mut Dice) -> Mesh {
    let mut mesh = Mesh::default();
    let size = dice.size([0.8, 2.0], [0.6, 1.0], [0.4, 0.7]);
    mesh.tapered(v(0.0, 0.0, size.z / 2.0), size, 1.1, 1.1, solid(0.4));
    let plant = v(size.x * 0.45, size.y * 0.45, dice.range(0.3, 0.8));
    mesh.blob(v(0.0, 0.0, size.z + 0.15), plant, (4, 8), 0.3, dice, LEAVES);
    mesh
}

/// A road works' barrier: boards on feet.
fn barrier(dice: &mut Dice) -> Mesh {
    let mut mesh = Mesh::default();
    let length = dice.range(1.2, 3.0);
    for z in [0.5, 0.95] {
        mesh.block(v(0.0, 0.0, z), v(0.04, length, 0.2), solid(0.8));
    }
    for side in [-0.4, 0.4] {
        mesh.block(v(0.0, side * length, 0.5), v(0.06, 0.06, 1.0), METAL);
        mesh.block(v(0.0, side * length, 0.05), v(0.6, 0.25, 0.1), RUBBER);
    }
    mesh
}
