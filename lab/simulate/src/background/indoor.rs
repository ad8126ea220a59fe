//! Inside a building: walls, ceiling, columns; racks, machines and pallets in a hall.

use super::super::layout::places::{AISLE_M, BAY_M};
use super::super::mesh::{GLASS, METAL, Mesh, Surface, solid, up, v};
use super::confusers::{cabinet, covered, pallets};
use super::{Builder, Place, Thing, Yard, built};
use crate::{background::furniture::bin, place::Room, random::Dice};
use std::f32::consts::{FRAC_PI_2, PI};

/// Maximum number of racks in a warehouse: each has many parts.
const RACKS_MAX: usize = 70;
/// Length and depth of a rack, m.
const RACK_M: [f32; 2] = [2.7, 1.1];

/// Places the building, and the things in it.
pub(super) fn place(yard: &mut Yard, room: &Room, dice: &mut Dice) {
    let is_hall = yard.ground.place == Place::Hall;
    shell(yard, room, is_hall, dice);
    if !is_hall {
        // Spacing: the ends of two rows, and three cars.
        columns(yard, room, [3.0 * BAY_M, AISLE_M], AISLE_M / 2.0, dice);
        let things: [(Thing, Builder); 2] = [(Thing::Cabinet, cabinet), (Thing::Bin, bin)];
        return scatter(yard, room, &things, 3.0, dice);
    }
    if dice.chance(0.6) {
        let spacing = [dice.range(5.0, 9.0), dice.range(6.0, 14.0)];
        columns(yard, room, spacing, dice.range(0.0, 5.0), dice);
    }
    let area = (room.along_m[1] - room.along_m[0]) * 2.0 * room.half_width_m;
    let stacks: [(Thing, Builder); 4] = [
        (Thing::Pallets, pallets),
        (Thing::Cabinet, cabinet),
        (Thing::Covered, covered),
        (Thing::Bin, bin),
    ];
    match dice.weighted(&[0.45, 0.3, 0.25]) {
        0 => racks(yard, room, dice),
        1 => scatter(yard, room, &[(Thing::Machine, machine)], area / 70.0, dice),
        _ => {}
    }
    scatter(yard, room, &stacks, (area / 120.0).min(20.0), dice);
}

/// Four walls and a ceiling with beams.
fn shell(yard: &mut Yard, room: &Room, is_hall: bool, dice: &mut Dice) {
    let [low, high] = room.along_m;
    let (half, middle) = (room.half_width_m, (low + high) / 2.0);
    let paint = solid(dice.range(0.3, 0.65));
    let walls = [
        (middle, half, 0.0, high - low),
        (middle, -half, PI, high - low),
        (high, 0.0, -FRAC_PI_2, 2.0 * half),
        (low, 0.0, FRAC_PI_2, 2.0 * half),
    ];
    for (along, across, yaw, length) in walls {
        let is_open = !is_hall && dice.chance(0.6);
        let mut mesh = Mesh::default();
        wall(&mut mesh, [length, room.height_m], is_open, paint, dice);
        // Walls are placed even where something already is.
        let (at, yaw, footprint) = yard.pose(&mesh, along, across, yaw);
        yard.layout.taken.push(footprint);
        yard.show(Thing::Building, &mesh, at, yaw, true);
    }
    let mut ceiling = Mesh::default();
    let bays = ((high - low) / dice.range(4.0, 8.0)).ceil();
    let bay = (high - low) / bays;
    let beam = v(0.25, 2.0 * half, if is_hall { 0.5 } else { 0.2 });
    for i in 0..bays as usize {
        let x = [low + i as f32 * bay, low + (i + 1) as f32 * bay];
        let corners = [(x[0], -half), (x[1], -half), (x[1], half), (x[0], half)];
        ceiling.quad(corners.map(|(x, y)| v(x, y, room.height_m)), paint);
        ceiling.block(v(x[0], 0.0, room.height_m - beam.z / 2.0), beam, METAL);
    }
    for _ in 0..dice.whole(0, 3) {
        let (y, below) = (dice.spread(half - 1.0), dice.range(0.15, 0.3));
        let ends = [low + 0.5, high - 0.5].map(|x| v(x, y, room.height_m - below));
        ceiling.rod(ends, dice.range(0.05, 0.12), 6, METAL);
    }
    // The ceiling hangs over the floor and takes no ground.
    let (x, y) = yard.ground.sensor(0.0, 0.0);
    yard.show(Thing::Ceiling, &ceiling, [x, y], yard.ground.yaw_rad, true);
}

/// A wall whose inner face is y = 0, seen from -y: pillars, recessed doors, windows high up; or a parapet that is open above.
fn wall(mesh: &mut Mesh, [length, height]: [f32; 2], open: bool, paint: Surface, dice: &mut Dice) {
    let bays = (length / dice.range(3.5, 7.0)).ceil().max(1.0);
    let bay = length / bays;
    let has_windows = height > 3.5 && dice.chance(0.4);
    for i in 0..bays as usize {
        let x = [i as f32, (i + 1) as f32].map(|n| n * bay - length / 2.0);
        let pillar = v(0.3, dice.range(0.15, 0.4), height + 0.3);
        mesh.block(v(x[0], -0.05, height / 2.0 - 0.15), pillar, paint);
        if open {
            mesh.block(v((x[0] + x[1]) / 2.0, 0.1, 0.4), v(bay, 0.15, 1.2), paint);
            continue;
        }
        let is_niche = dice.chance(0.2);
        let depth = if is_niche { dice.range(0.1, 0.5) } else { 0.0 };
        let top = if has_windows { 2.4 } else { height };
        mesh.pane(x, depth, [-0.3, top], paint);
        if has_windows {
            mesh.pane(x, 0.05, [top, height - 0.6], GLASS);
            mesh.pane(x, 0.0, [height - 0.6, height], paint);
        }
        if depth > 0.0 {
            for x in x {
                let side = [(0.0, -0.3), (depth, -0.3), (depth, top), (0.0, top)];
                mesh.quad(side.map(|(y, z)| v(x, y, z)), paint);
            }
        }
    }
}

/// Columns from floor to ceiling on a grid.
fn columns(
    yard: &mut Yard,
    room: &Room,
    [along_m, across_m]: [f32; 2],
    first_m: f32,
    dice: &mut Dice,
) {
    let height = room.height_m + 0.2;
    let size = v(dice.range(0.3, 0.7), dice.range(0.3, 0.7), height);
    let mut mesh = Mesh::default();
    mesh.block(up(size.z / 2.0 - 0.2), size, solid(dice.range(0.3, 0.5)));
    let rows = (2.0 * room.half_width_m / across_m).ceil();
    let [low, high] = room.along_m;
    for i in 0..((high - low) / along_m) as usize {
        for row in 0..=rows as usize {
            // At the boundary of two bays: the centre of a bay is half a width from its boundary.
            let along = ((low / along_m).ceil() + i as f32) * along_m;
            let across = first_m + (row as f32 - (rows / 2.0).ceil()) * across_m;
            if room.holds((along, across), 0.6) {
                yard.put(Thing::Column, &mesh, along, across, 0.0);
            }
        }
    }
}

/// Rows of racks with free aisles.
fn racks(yard: &mut Yard, room: &Room, dice: &mut Dice) {
    let lane_m = dice.range(2.6, 4.5);
    let pitch_m = 2.0 * RACK_M[1] + 0.15 + lane_m;
    let levels = ((room.height_m - 1.0) / 1.6).floor().clamp(1.0, 5.0) as usize;
    let margin = dice.range(2.5, 5.0);
    let [low, high] = [room.along_m[0] + margin, room.along_m[1] - margin];
    let mut left = RACKS_MAX;
    // The rows nearest to the sensor come first.
    let mut rows: Vec<f32> = (-8..=8)
        .flat_map(|row| {
            let middle = yard.ground.lane_m + (row as f32 + 0.5) * pitch_m;
            [-1.0, 1.0].map(|side| middle + side * (RACK_M[1] / 2.0 + 0.07))
        })
        .filter(|across| room.holds((low, *across), RACK_M[1]))
        .collect();
    let lane_m = yard.ground.lane_m;
    rows.sort_by(|a, b| (a - lane_m).abs().total_cmp(&(b - lane_m).abs()));
    for across in rows {
        let mut along = low + RACK_M[0] / 2.0;
        while along < high && left > 0 {
            if dice.chance(0.93) {
                let mesh = built(|mesh, dice| rack(mesh, levels, dice), dice);
                left -= usize::from(yard.put(Thing::Rack, &mesh, along, across, 0.0));
            }
            along += RACK_M[0] + 0.02;
        }
    }
}

/// Four uprights, beams, and pallets with loads in most of the places.
fn rack(mesh: &mut Mesh, levels: usize, dice: &mut Dice) {
    let [length, depth] = RACK_M;
    let height = 1.6 * levels as f32;
    for x in [-0.5, 0.5] {
        let upright = v(x * (length - 0.1), depth / 2.0 - 0.05, height / 2.0);
        mesh.twins(upright, v(0.1, 0.08, height), METAL);
    }
    for level in 0..levels {
        let z = 1.6 * level as f32 + 0.08;
        if level > 0 {
            mesh.twins(v(0.0, depth / 2.0 - 0.04, z), v(length, 0.05, 0.12), METAL);
        }
        for x in [-0.88, 0.0, 0.88] {
            if dice.chance(0.7) {
                let load = dice.size([0.7, 0.85], [0.8, 1.05], [0.3, 1.35]);
                let at = v(x, dice.spread(0.03), z + 0.06 + load.z / 2.0);
                mesh.block(at, load, solid(dice.range(0.15, 0.6)));
            }
        }
    }
}

/// A machine: some blocks, a drum, a pipe.
pub(super) fn machine(mesh: &mut Mesh, dice: &mut Dice) {
    let paint = solid(dice.range(0.15, 0.55));
    let bed = dice.size([1.0, 4.0], [0.8, 1.8], [0.5, 1.2]);
    mesh.block(up(bed.z / 2.0), bed, paint);
    for _ in 0..dice.whole(1, 3) {
        let part = dice.size([0.3, 1.2], [0.3, 1.0], [0.3, 1.3]);
        let (x, y) = (dice.spread(bed.x * 0.35), dice.spread(bed.y * 0.25));
        let top = [(); 2].map(|()| dice.range(0.6, 1.0));
        mesh.tapered(v(x, y, bed.z + part.z / 2.0), part, top, paint);
    }
    if dice.chance(0.5) {
        let ends = [-0.45, 0.2].map(|x| v(x * bed.x, bed.y * 0.2, bed.z + 0.3));
        mesh.rod(ends, dice.range(0.15, 0.4), 9, METAL);
    }
    if dice.chance(0.4) {
        let top = bed.z + dice.range(1.0, 2.5);
        let ends = [0.0, top].map(|z| v(bed.x * 0.4, 0.0, z));
        mesh.rod(ends, 0.08, 6, METAL);
    }
}

/// Places about `mean` of these things anywhere on the floor; a third of them along the walls.
fn scatter(yard: &mut Yard, room: &Room, things: &[(Thing, Builder)], mean: f32, dice: &mut Dice) {
    for _ in 0..dice.events(mean.min(25.0)) {
        let (thing, build) = things[dice.whole(0, things.len() - 1)];
        let mesh = built(build, dice);
        let along = dice.range(room.along_m[0] + 1.0, room.along_m[1] - 1.0);
        let half = room.half_width_m - 1.0;
        let across = if dice.chance(0.35) { dice.sign() * half } else { dice.spread(half) };
        let yaw = FRAC_PI_2 * dice.whole(0, 3) as f32 + dice.normal(0.0, 0.05);
        yard.put(thing, &mesh, along, across, yaw);
    }
}
