//! Things of a car's, a person's or a cyclist's size that are none: what makes false unknowns a real problem.

use super::super::mesh::{METAL, Mesh, solid, v};
use super::super::random::Dice;
use super::{Place, Thing, Yard};

/// One to five per frame in three frames of four, within 15 m of the road.
pub(super) fn place(yard: &mut Yard<'_, '_>, dice: &mut Dice) {
    if !dice.chance(0.78) {
        return;
    }
    let industrial = yard.is(Place::Industrial) || yard.is(Place::Plaza);
    for _ in 0..dice.whole(1, 5) {
        let weights = if industrial {
            [3.0, 2.0, 3.0, 1.0, 1.0, 2.0]
        } else {
            [0.6, 2.0, 0.8, 0.5, 2.0, 2.0]
        };
        let (thing, mesh) = match dice.weighted(&weights) {
            0 => (Thing::Container, container(dice)),
            1 => (Thing::Dumpster, dumpster(dice)),
            2 => (Thing::Pallets, pallets(dice)),
            3 => (Thing::GasTank, gas_tank(dice)),
            4 => (Thing::Cabinet, cabinet(dice)),
            _ => (Thing::Covered, covered(dice)),
        };
        let yaw = std::f32::consts::FRAC_PI_2 * dice.whole(0, 1) as f32 + dice.normal(0.0, 0.15);
        for _ in 0..6 {
            let along = yard.somewhere(dice);
            let across = if dice.chance(0.2) {
                yard.on_pavement(dice)
            } else {
                yard.behind(13.0, dice)
            };
            if yard.put(thing, &mesh, along, across, yaw) {
                break;
            }
        }
    }
}

/// A freight container, 20 or 10 feet, with corrugated sides.
fn container(dice: &mut Dice) -> Mesh {
    let size = v(if dice.chance(0.7) { 6.06 } else { 2.99 }, 2.44, 2.59);
    let paint = solid(dice.range(0.12, 0.45));
    let mut mesh = Mesh::default();
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
        mesh.loft(&rings, false, |_, _| Some(paint));
    }
    let body = v(size.x, size.y - 0.12, size.z);
    mesh.block(v(0.0, 0.0, size.z / 2.0), body, paint);
    mesh
}

/// A skip with sloping ends, or a wheeled waste container.
fn dumpster(dice: &mut Dice) -> Mesh {
    let mut mesh = Mesh::default();
    let paint = solid(dice.range(0.1, 0.4));
    if dice.chance(0.5) {
        let size = dice.size([2.6, 4.2], [1.5, 1.9], [1.1, 1.6]);
        let skip = v(size.x * 0.65, size.y, size.z);
        mesh.tapered(v(0.0, 0.0, size.z / 2.0), skip, 1.5, 1.0, paint);
        for x in [-0.25, 0.25] {
            let rib = v(0.12, size.y * 1.06, size.z * 0.9);
            mesh.block(v(x * size.x, 0.0, size.z * 0.5), rib, paint);
        }
        if dice.chance(0.6) {
            let heap = v(0.35 * size.x, 0.4 * size.y, 0.4);
            mesh.blob(v(0.0, 0.0, size.z), heap, (4, 8), 0.3, dice, solid(0.25));
        }
    } else {
        for i in 0..dice.whole(1, 3) {
            let at = v(i as f32 * 1.5, 0.0, 0.75);
            mesh.tapered(at, v(1.36, 1.0, 1.1), 1.05, 1.05, paint);
            mesh.tapered(at + v(0.0, 0.0, 0.62), v(1.4, 1.1, 0.14), 0.9, 0.7, paint);
        }
    }
    mesh
}

/// Stacks of pallets, bare or loaded.
fn pallets(dice: &mut Dice) -> Mesh {
    let mut mesh = Mesh::default();
    let wood = solid(0.4);
    let columns = dice.whole(1, 4);
    for c in 0..columns {
        let at = v(c as f32 * 1.3, dice.spread(0.1), 0.0);
        let count = dice.whole(1, 10);
        for i in 0..count {
            let z = 0.15 * i as f32 + 0.06;
            mesh.block(at + v(0.0, 0.0, z), v(1.2, 0.8, 0.09), wood);
        }
        if dice.chance(0.5) {
            let h = dice.range(0.4, 1.2);
            let load = at + v(0.0, 0.0, 0.15 * count as f32 + h / 2.0);
            mesh.block(load, v(1.1, 0.78, h), solid(dice.range(0.2, 0.6)));
        }
    }
    mesh
}

/// A lying gas tank on feet.
fn gas_tank(dice: &mut Dice) -> Mesh {
    let (length, radius) = (dice.range(2.5, 4.5), dice.range(0.6, 0.7));
    let mut mesh = Mesh::default();
    let z = radius + 0.25;
    let ends = [-1.0, 1.0].map(|side: f32| v(side * length / 2.0, 0.0, z));
    mesh.rod(ends, radius, 12, solid(0.6));
    for (end, side) in ends.into_iter().zip([-1.0, 1.0]) {
        let lid = v(0.3, radius, radius);
        mesh.blob(end, lid, (4, 10), 0.0, dice, solid(0.6));
        let foot = v(side * length * 0.35, 0.0, 0.15);
        mesh.block(foot, v(0.25, radius * 1.5, 0.3), solid(0.3));
    }
    mesh.block(v(0.0, 0.0, z + radius + 0.1), v(0.4, 0.4, 0.2), METAL);
    mesh
}

/// A switch cabinet or transformer house.
fn cabinet(dice: &mut Dice) -> Mesh {
    let size = if dice.chance(0.6) {
        v(dice.range(0.7, 1.4), 0.4, dice.range(1.0, 1.5))
    } else {
        dice.size([1.8, 3.0], [1.4, 2.0], [1.4, 2.2])
    };
    let mut mesh = Mesh::default();
    mesh.block(v(0.0, 0.0, size.z / 2.0), size, solid(dice.range(0.3, 0.6)));
    let lid = v(size.x + 0.08, size.y + 0.08, 0.09);
    mesh.tapered(v(0.0, 0.0, size.z + 0.04), lid, 0.95, 0.9, solid(0.3));
    let handle = v(0.0, size.y / 2.0 + 0.01, size.z * 0.5);
    mesh.block(handle, v(0.06, 0.04, 0.3), METAL);
    mesh
}

/// Something under a tarpaulin, a heap of gravel or of cut branches: about as large as a car, of no particular shape.
fn covered(dice: &mut Dice) -> Mesh {
    let size = dice.size([1.4, 4.6], [1.1, 2.2], [0.6, 1.8]);
    let surface = solid(dice.range(0.12, 0.5));
    let mut mesh = Mesh::default();
    let radii = v(size.x / 2.0, size.y / 2.0, size.z * 0.65);
    mesh.blob(
        v(0.0, 0.0, size.z * 0.35),
        radii,
        (6, 11),
        0.12,
        dice,
        surface,
    );
    mesh.map(|p| v(p.x, p.y, p.z.max(0.0)));
    mesh
}
