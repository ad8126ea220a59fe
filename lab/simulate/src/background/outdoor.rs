//! Open places: the lamps and islands of a car park, the stacks and piles of a depot, and the growth along a path.

use super::super::mesh::{Mesh, V3, porous, solid, up, v};
use super::confusers::{container, covered, dumpster, gas_tank, pallets};
use super::furniture::{bench, pole, shelter, sign};
use super::{Builder, Thing, Yard, built, vegetation::bush, vegetation::tree};
use crate::{background::indoor::machine, layout::places::AISLE_M, random::Dice};
use std::f32::consts::{FRAC_PI_2, PI};

/// Lamp posts, low islands and trees between the rows; shelters for trolleys.
pub(super) fn car_park(yard: &mut Yard, dice: &mut Dice) {
    let half = yard.ground.half_width_m;
    let spacing_m = dice.range(12.0, 30.0);
    let has_trees = dice.chance(0.4);
    for row in -3..=2 {
        let across = (row as f32 + 0.5) * AISLE_M;
        let mut along = -72.0 + dice.range(0.0, spacing_m);
        while across.abs() < half && along < 72.0 {
            let mesh = built(pole, dice);
            if has_trees && dice.chance(0.6) {
                tree(yard, along, across, dice.range(0.5, 0.9), dice);
            } else {
                yard.put(Thing::Pole, &mesh, along, across, FRAC_PI_2);
            }
            along += spacing_m;
        }
    }
    for _ in 0..dice.whole(0, 3) {
        let across = (dice.spread(1.49).round() + 0.5) * AISLE_M + dice.sign() * 2.5;
        let mesh = built(shelter, dice);
        yard.put(Thing::Shelter, &mesh, dice.spread(50.0), across, FRAC_PI_2);
    }
    for _ in 0..dice.whole(0, 6) {
        let size = dice.size([2.0, 5.0], [0.8, 2.0], [0.12, 0.25]);
        let mut island = Mesh::default();
        island.block(up(size.z / 2.0 - 0.1), size, solid(0.3));
        let across = (dice.spread(1.49).round() + 0.5) * AISLE_M;
        let along = dice.spread(60.0);
        yard.put(Thing::Planter, &island, along, across, FRAC_PI_2);
    }
}

/// Containers in stacks, pallets, machines, tanks and piles; the middle stays free.
pub(super) fn depot(yard: &mut Yard, dice: &mut Dice) {
    let things: [(Thing, Builder); 6] = [
        (Thing::Container, stack),
        (Thing::Pallets, pallets),
        (Thing::Machine, machine),
        (Thing::Pile, pile),
        (Thing::GasTank, gas_tank),
        (Thing::Dumpster, dumpster),
    ];
    let weights: [f32; 6] = std::array::from_fn(|_| dice.range(0.1, 1.0));
    let half = yard.ground.half_width_m;
    for _ in 0..dice.whole(12, 34) {
        let (thing, build) = things[dice.weighted(&weights)];
        let mesh = built(build, dice);
        let across = if dice.chance(0.6) {
            dice.sign() * half * dice.range(0.6, 1.0)
        } else {
            dice.spread(half)
        };
        let yaw = FRAC_PI_2 * dice.whole(0, 1) as f32 + dice.normal(0.0, 0.08);
        let along = yard.somewhere(dice);
        yard.put(thing, &mesh, along, across, yaw);
    }
}

/// A stack of one to three containers.
fn stack(mesh: &mut Mesh, dice: &mut Dice) {
    let one = built(container, dice);
    for level in 0..dice.whole(1, 3) {
        let shift = v(dice.spread(0.05), dice.spread(0.05), 2.59 * level as f32);
        mesh.add(&one, |p| p + shift);
    }
}

/// Gravel, earth or scrap: a rough cone.
fn pile(mesh: &mut Mesh, dice: &mut Dice) {
    let radius = dice.range(1.0, 4.0);
    let height = radius * dice.range(0.45, 0.8);
    let surface = solid(dice.range(0.15, 0.45));
    let radii = v(radius, radius * dice.range(0.7, 1.0), height);
    mesh.blob(up(-0.1), radii, (10, 13), 0.1, dice, surface);
    mesh.map(|p| v(p.x, p.y, p.z.max(-0.2)));
}

/// Trunks, bushes, tall grass, rocks and logs on both sides of a path, fewer with distance; sometimes a bench or a sign next to it.
pub(super) fn path(yard: &mut Yard, dice: &mut Dice) {
    let density = dice.range(0.3, 1.0);
    for _ in 0..dice.events(55.0 * density) {
        let (along, across) = beside_path(yard, 0.6, dice);
        tree(yard, along, across, dice.range(0.6, 1.5), dice);
    }
    let things: [(Thing, Builder, f32); 5] = [
        (Thing::Grass, grass, 50.0),
        (Thing::Bush, bush, 35.0),
        (Thing::Rock, rock, 14.0),
        (Thing::Log, log, 7.0),
        (Thing::Covered, covered, 2.0),
    ];
    for (thing, build, mean) in things {
        let mean = mean * dice.range(0.2, 1.0);
        for _ in 0..dice.events(mean) {
            let mesh = built(build, dice);
            let (along, across) = beside_path(yard, 0.4, dice);
            yard.put(thing, &mesh, along, across, dice.spread(PI));
        }
    }
    let at_it: [(Thing, Builder); 3] =
        [(Thing::Bench, bench), (Thing::Sign, sign), (Thing::Pole, pole)];
    for (thing, build) in at_it {
        for _ in 0..dice.events(2.0) {
            let mesh = built(build, dice);
            let (along, _) = beside_path(yard, 0.0, dice);
            let across = dice.sign() * (yard.ground.edge_m + dice.range(0.4, 1.5));
            yard.put(thing, &mesh, along, across, FRAC_PI_2 * across.signum());
        }
    }
}

/// Position along and across, at least this far from the path's edge.
fn beside_path(yard: &Yard, gap_m: f32, dice: &mut Dice) -> (f32, f32) {
    let away = gap_m + 38.0 * dice.unit().powi(2);
    let along = yard.somewhere(dice);
    (along, dice.sign() * (yard.ground.edge_m + away))
}

/// A patch of tall grass: blades stop part of the rays.
fn grass(mesh: &mut Mesh, dice: &mut Dice) {
    let (radius, height) = (dice.range(0.5, 2.2), dice.range(0.2, 0.9));
    let blades = porous(0.35, dice.range(0.45, 0.75));
    for _ in 0..(8.0 * radius) as usize {
        let at = v(dice.spread(radius), dice.spread(radius), 0.0);
        let (sin, cos) = dice.spread(PI).sin_cos();
        let half = dice.range(0.2, 0.6);
        let tall = height * dice.range(0.5, 1.0);
        let lean = v(dice.spread(0.15), dice.spread(0.15), tall);
        let side = v(cos * half, sin * half, 0.0);
        let (foot, tip) = (at - up(0.1), side * 0.7);
        let corners = [foot - side, foot + side, at + tip + lean, at - tip + lean];
        mesh.quad(corners, blades);
    }
}

fn rock(mesh: &mut Mesh, dice: &mut Dice) {
    let radii: V3 = dice.size([0.2, 1.1], [0.2, 0.9], [0.15, 0.8]);
    mesh.blob(up(radii.z * 0.4), radii, (5, 8), 0.2, dice, solid(0.3));
}

fn log(mesh: &mut Mesh, dice: &mut Dice) {
    let (half, radius) = (dice.range(0.6, 3.0), dice.range(0.1, 0.35));
    for i in 0..dice.whole(1, 3) {
        let at = v(0.0, i as f32 * radius * 2.0, radius);
        let ends = [-half, half].map(|x| at + v(x, dice.spread(0.1), 0.0));
        mesh.tube(ends, [radius, radius * 0.85], 8, solid(0.25));
    }
}
