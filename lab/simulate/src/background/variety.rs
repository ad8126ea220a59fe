//! Additions to streets of `sim-any`: guard rails, long walls and fences on rising ground, rows of bicycles, posts near people, depth in facades.

use super::super::layout::{Placed, half_turn};
use super::super::mesh::{METAL, Mesh, porous, solid, up, v};
use super::super::{Class, objects::street, random::Dice};
use super::{Thing, Yard, built, furniture::bicycles};
use std::f32::consts::{FRAC_PI_2, TAU};

/// Things closer to the road than its frontage, and long lines behind it.
pub(super) fn place(yard: &mut Yard, dice: &mut Dice) {
    for side in [-1.0, 1.0] {
        if dice.chance(0.2) {
            let across = side * (yard.ground.half_width_m + dice.range(0.3, 1.0));
            line(yard, Thing::Rail, across, dice);
        }
        if dice.chance(0.35) {
            let across = side * (yard.ground.edge_m + dice.range(0.5, 12.0));
            let kind = [Thing::Wall, Thing::Fence][dice.whole(0, 1)];
            line(yard, kind, across, dice);
        }
    }
    for _ in 0..dice.events(2.5) {
        let mesh = built(bicycles, dice);
        let edge = [yard.ground.half_width_m + 0.5, yard.ground.edge_m - 0.4];
        let across = dice.sign() * edge[dice.whole(0, 1)];
        let along = yard.somewhere(dice) * 0.5;
        let yaw = FRAC_PI_2 * dice.sign();
        yard.put(Thing::Bicycles, &mesh, along, across, yaw);
    }
    posts_near_people(yard, dice);
    let busy = dice.range(0.2, 1.8);
    for kind in street() {
        for _ in 0..dice.events(busy * kind.per_100_m * yard.hundreds()) {
            let mesh = kind.built(dice);
            let along = yard.somewhere(dice);
            // Half of them are close to the edge of the street.
            let across = match dice.chance(0.5) {
                true => dice.sign() * (yard.ground.edge_m + dice.range(-0.6, 0.1)),
                false => yard.beside(0.6, 5.0, dice),
            };
            let yaw = FRAC_PI_2 * dice.whole(0, 3) as f32 + dice.normal(0.0, 0.2);
            yard.put(Thing::Street, &mesh, along, across, yaw);
        }
    }
}

/// Pieces of 6 m that follow the ground: a guard rail, a plain wall or a fence.
fn line(yard: &mut Yard, kind: Thing, across: f32, dice: &mut Dice) {
    let [low, high] = yard.along_m();
    let start = dice.range(low, high - 20.0);
    let end = (start + dice.range(18.0, 90.0)).min(high);
    let height = dice.range(0.7, 3.2);
    let surface = solid(dice.range(0.2, 0.6));
    let wire = porous(0.3, dice.range(0.4, 0.75));
    let yaw = half_turn(across <= 0.0);
    let mut along = start;
    while along < end {
        let mut mesh = Mesh::default();
        match kind {
            Thing::Rail => {
                for z in [0.5, 0.68] {
                    mesh.block(up(z), v(6.0, 0.06, 0.13), METAL);
                }
                for x in [-2.0, 0.0, 2.0] {
                    mesh.block(v(x, 0.09, 0.3), v(0.1, 0.12, 0.85), METAL);
                }
            }
            Thing::Fence => {
                let height = height.min(2.4);
                mesh.pane([-3.0, 3.0], 0.0, [0.05, height], wire);
                for x in [-2.95, 0.0] {
                    mesh.block(v(x, 0.0, height / 2.0), v(0.06, 0.06, height), METAL);
                }
            }
            _ => mesh.block(up(height / 2.0 - 0.3), v(6.0, 0.25, height + 0.6), surface),
        }
        let near = |[at, half]: [f32; 2]| (along - at).abs() < half + 3.5;
        if !yard.ground.crossing.is_some_and(near) {
            yard.put(kind, &mesh, along, across, yaw);
        }
        along += 6.22;
    }
}

/// A post, a sign's pole or a bollard near some people: similar to people on sensors with few beams.
fn posts_near_people(yard: &mut Yard, dice: &mut Dice) {
    let people = yard.layout.placed.iter().filter(|o| o.class == Class::Pedestrian);
    let place = |o: &Placed| yard.ground.road(o.footprint.x, o.footprint.y);
    let places: Vec<_> = people.map(place).collect();
    for (along, across) in places {
        if dice.chance(0.3) {
            let (sin, cos) = dice.range(0.0, TAU).sin_cos();
            let away = dice.range(0.7, 3.0);
            let mesh = built(post, dice);
            let (along, across) = (along + away * cos, across + away * sin);
            yard.put(Thing::Pole, &mesh, along, across, 0.0);
        }
    }
}

fn post(mesh: &mut Mesh, dice: &mut Dice) {
    let (height, radius) = (dice.range(0.8, 2.8), dice.range(0.03, 0.16));
    let paint = solid(dice.range(0.2, 0.5));
    mesh.tube([up(-0.2), up(height)], [radius, radius * 0.9], 7, paint);
}

/// Depth in front of a facade (the plane y = 0, seen from -y): balconies, pillars under a slab, protruding bays.
pub(super) fn facade(mesh: &mut Mesh, length: f32, dice: &mut Dice) {
    let top = mesh.bounds().1.z;
    let stone = solid(dice.range(0.25, 0.6));
    match dice.weighted(&[0.4, 0.25, 0.15, 0.2]) {
        0 => {}
        1 => {
            let depth = dice.range(0.8, 1.6);
            for x in [-0.3, 0.3].map(|share| share * length) {
                let mut z = dice.range(2.7, 3.4);
                while z + 2.0 < top {
                    mesh.block(v(x, -depth / 2.0, z), v(2.6, depth, 0.18), stone);
                    mesh.pane([x - 1.3, x + 1.3], -depth, [z, z + 1.0], porous(0.35, 0.4));
                    z += 3.0;
                }
            }
        }
        2 => {
            let depth = dice.range(1.2, 2.6);
            mesh.block(v(0.0, -depth / 2.0, 3.3), v(length, depth, 0.3), stone);
            for i in 0..=(length / 3.5) as usize {
                let x = 0.2 - length / 2.0 + 3.5 * i as f32;
                mesh.block(v(x, 0.2 - depth, 1.5), v(0.35, 0.35, 3.6), stone);
            }
        }
        _ => {
            let bay = dice.size([1.5, 3.5], [0.6, 1.4], [2.5, 6.0]);
            for x in [-0.27, 0.27].map(|share| share * length) {
                mesh.block(v(x, -bay.y / 2.0, bay.z / 2.0 - 0.3), bay, stone);
            }
        }
    }
}
