//! Background of the size of a car, a person or a cyclist: it makes false unknown objects realistic.

use super::super::mesh::{METAL, Mesh, solid, up, v};
use super::super::random::Dice;
use super::{Builder, Thing, Yard, built};

/// Kind, builder, and weight in towns and in industry.
const CATALOGUE: [(Thing, Builder, [f32; 2]); 6] = [
    (Thing::Container, container, [0.6, 3.0]),
    (Thing::Dumpster, dumpster, [2.0, 2.0]),
    (Thing::Pallets, pallets, [0.8, 3.0]),
    (Thing::GasTank, gas_tank, [0.5, 1.0]),
    (Thing::Cabinet, cabinet, [2.0, 1.0]),
    (Thing::Covered, covered, [2.0, 2.0]),
];

/// One to five per frame in three of four frames, within 15 m of the road.
pub(super) fn place(yard: &mut Yard, dice: &mut Dice) {
    if !dice.chance(0.78) {
        return;
    }
    let weights = CATALOGUE.map(|row| row.2[yard.column()]);
    for _ in 0..dice.whole(1, 5) {
        let (thing, build, _) = CATALOGUE[dice.weighted(&weights)];
        let mesh = built(build, dice);
        let yaw = std::f32::consts::FRAC_PI_2 * dice.whole(0, 1) as f32 + dice.normal(0.0, 0.15);
        for _ in 0..6 {
            let along = yard.somewhere(dice);
            let across = yard.beside(0.2, 13.0, dice);
            if yard.put(thing, &mesh, along, across, yaw) {
                break;
            }
        }
    }
}

/// A freight container, 20 or 10 feet, with corrugated sides.
pub(super) fn container(mesh: &mut Mesh, dice: &mut Dice) {
    let size = v(if dice.chance(0.7) { 6.06 } else { 2.99 }, 2.44, 2.59);
    let paint = solid(dice.range(0.12, 0.45));
    let folds = (size.x / 0.3) as usize;
    for side in [-1.0, 1.0] {
        let rings = [0.05, size.z - 0.05].map(|z| {
            let fold = |i: usize| {
                let depth = if i.is_multiple_of(2) { 0.0 } else { 0.04 };
                let x = size.x * (i as f32 / folds as f32 - 0.5);
                v(x, side * (size.y / 2.0 - depth), z)
            };
            (0..=folds).map(fold).collect::<Vec<_>>()
        });
        mesh.loft(&rings, false, |_, _| paint);
    }
    let body = v(size.x, size.y - 0.12, size.z);
    mesh.block(up(size.z / 2.0), body, paint);
}

/// A skip with sloping ends, or a wheeled waste container.
pub(super) fn dumpster(mesh: &mut Mesh, dice: &mut Dice) {
    let paint = solid(dice.range(0.1, 0.4));
    if dice.chance(0.5) {
        let size = dice.size([2.6, 4.2], [1.5, 1.9], [1.1, 1.6]);
        let skip = v(size.x * 0.65, size.y, size.z);
        mesh.tapered(up(size.z / 2.0), skip, [1.5, 1.0], paint);
        for x in [-0.25, 0.25] {
            let rib = v(0.12, size.y * 1.06, size.z * 0.9);
            mesh.block(v(x * size.x, 0.0, size.z * 0.5), rib, paint);
        }
        if dice.chance(0.6) {
            let heap = v(0.35 * size.x, 0.4 * size.y, 0.4);
            mesh.blob(up(size.z), heap, (4, 8), 0.3, dice, solid(0.25));
        }
    } else {
        for i in 0..dice.whole(1, 3) {
            let at = v(i as f32 * 1.5, 0.0, 0.75);
            mesh.tapered(at, v(1.36, 1.0, 1.1), [1.05, 1.05], paint);
            mesh.tapered(at + up(0.62), v(1.4, 1.1, 0.14), [0.9, 0.7], paint);
        }
    }
}

/// Stacks of pallets, empty or loaded.
pub(super) fn pallets(mesh: &mut Mesh, dice: &mut Dice) {
    for c in 0..dice.whole(1, 4) {
        let at = v(c as f32 * 1.3, dice.spread(0.1), 0.0);
        let count = dice.whole(1, 10);
        for i in 0..count {
            let center = at + up(0.15 * i as f32 + 0.06);
            mesh.block(center, v(1.2, 0.8, 0.09), solid(0.4));
        }
        if dice.chance(0.5) {
            let h = dice.range(0.4, 1.2);
            let load = at + up(0.15 * count as f32 + h / 2.0);
            mesh.block(load, v(1.1, 0.78, h), solid(dice.range(0.2, 0.6)));
        }
    }
}

/// A lying gas tank on feet.
pub(super) fn gas_tank(mesh: &mut Mesh, dice: &mut Dice) {
    let (length, radius) = (dice.range(2.5, 4.5), dice.range(0.6, 0.7));
    let z = radius + 0.25;
    let ends = [-1.0, 1.0].map(|side: f32| v(side * length / 2.0, 0.0, z));
    mesh.rod(ends, radius, 12, solid(0.6));
    for (end, side) in ends.into_iter().zip([-1.0, 1.0]) {
        let lid = v(0.3, radius, radius);
        mesh.blob(end, lid, (4, 10), 0.0, dice, solid(0.6));
        let foot = v(side * length * 0.35, 0.0, 0.15);
        mesh.block(foot, v(0.25, radius * 1.5, 0.3), solid(0.3));
    }
    mesh.block(up(z + radius + 0.1), v(0.4, 0.4, 0.2), METAL);
}

/// A switch cabinet or transformer house.
pub(super) fn cabinet(mesh: &mut Mesh, dice: &mut Dice) {
    let size = if dice.chance(0.6) {
        v(dice.range(0.7, 1.4), 0.4, dice.range(1.0, 1.5))
    } else {
        dice.size([1.8, 3.0], [1.4, 2.0], [1.4, 2.2])
    };
    mesh.block(up(size.z / 2.0), size, solid(dice.range(0.3, 0.6)));
    let lid = v(size.x + 0.08, size.y + 0.08, 0.09);
    mesh.tapered(up(size.z + 0.04), lid, [0.95, 0.9], solid(0.3));
    let handle = v(0.0, size.y / 2.0 + 0.01, size.z * 0.5);
    mesh.block(handle, v(0.06, 0.04, 0.3), METAL);
}

/// Something under a tarpaulin, a heap of gravel or of cut branches: about as large as a car, of irregular shape.
pub(super) fn covered(mesh: &mut Mesh, dice: &mut Dice) {
    let size = dice.size([1.4, 4.6], [1.1, 2.2], [0.6, 1.8]);
    let surface = solid(dice.range(0.12, 0.5));
    let radii = v(size.x / 2.0, size.y / 2.0, size.z * 0.65);
    mesh.blob(up(size.z * 0.35), radii, (6, 11), 0.12, dice, surface);
    mesh.map(|p| v(p.x, p.y, p.z.max(0.0)));
}
