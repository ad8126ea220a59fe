//! Frontages on both sides of a road: houses, walls, fences, hedges; and houses further back.

use super::super::mesh::{GLASS, Mesh, Surface, mirrored, porous, solid, up, v};
use super::{Family, Place, Thing, Yard, built, vegetation::bush, vegetation::thicket};
use crate::{background::variety::facade, layout::half_turn, random::Dice};

/// Fills each side in pieces of 7 to 24 m.
pub(super) fn place(yard: &mut Yard, dice: &mut Dice) {
    let [low, high] = yard.along_m();
    for side in [-1.0f32, 1.0] {
        let mut along = low - dice.range(0.0, 8.0);
        let setback = match yard.ground.place {
            Place::Urban => dice.range(0.1, 2.5),
            Place::Industrial => dice.range(2.0, 10.0),
            _ => dice.range(1.0, 6.0),
        };
        while along < high {
            let length = dice.range(7.0, 24.0);
            let middle = along + length / 2.0;
            let near = |[at, half]: [f32; 2]| (middle - at).abs() < half + length / 2.0;
            if !yard.ground.crossing.is_some_and(near) {
                let setback = setback + dice.spread(0.6).max(-setback);
                piece(yard, side, middle, length, setback, dice);
            }
            let open = dice.chance(0.4);
            along += length + if open { dice.range(1.0, 6.0) } else { 0.0 };
        }
    }
}

type PieceBuilder = fn(&mut Mesh, f32, &mut Dice);

/// One piece of a frontage: its middle and length along the road, and the setback of houses.
fn piece(yard: &mut Yard, side: f32, along: f32, length: f32, setback: f32, dice: &mut Dice) {
    // Houses, wall, fence, hedge, thicket, open.
    let weights = match yard.ground.place {
        Place::Urban => [0.5, 0.08, 0.07, 0.08, 0.19, 0.08],
        Place::Suburb => [0.2, 0.07, 0.1, 0.15, 0.42, 0.06],
        Place::Industrial => [0.34, 0.09, 0.2, 0.05, 0.2, 0.12],
        _ => [0.34, 0.09, 0.11, 0.1, 0.26, 0.1],
    };
    let edge = yard.ground.edge_m;
    let choice = dice.weighted(&weights);
    if choice == 0 {
        let size = [length * 0.97, dice.range(6.0, 13.0)];
        let hall = yard.ground.place == Place::Industrial;
        let mut mesh = built(|mesh, dice| house(mesh, size, hall, dice), dice);
        if yard.layout.options.family == Family::SimAny {
            facade(&mut mesh, length, dice);
        }
        // The facade (local y = 0) faces the road; a second row is further back where the first place is taken.
        let front = side * (edge + setback);
        if !yard.put(Thing::Building, &mesh, along, front, half_turn(side < 0.0)) {
            let back = side * (edge + setback + dice.range(8.0, 16.0));
            yard.put(Thing::Building, &mesh, along, back, half_turn(side < 0.0));
        }
        return;
    }
    let line = side * (edge + dice.range(0.15, 0.8));
    let (thing, build): (Thing, PieceBuilder) = match choice {
        1 => (Thing::Wall, wall),
        2 => (Thing::Fence, fence),
        3 => (Thing::Hedge, hedge),
        4 => (Thing::Bush, thicket),
        _ => return back_house(yard, side, along, dice),
    };
    let mut mesh = built(|mesh, dice| build(mesh, length, dice), dice);
    if yard.layout.options.family == Family::SimAny && choice > 2 {
        // Vegetation here is taller than in a garden.
        let taller = dice.range(0.8, 2.5);
        mesh.map(|p| v(p.x, p.y, p.z * taller));
    }
    yard.put(thing, &mesh, along, line, half_turn(side < 0.0));
    for _ in 0..dice.whole(0, 4) {
        // Vegetation behind it.
        let bush = built(bush, dice);
        let along = along + dice.spread(length / 2.0);
        let across = line + side * dice.range(0.9, 3.5);
        yard.put(Thing::Bush, &bush, along, across, 0.0);
    }
    if dice.chance(0.6) {
        back_house(yard, side, along, dice);
    }
}

fn back_house(yard: &mut Yard, side: f32, along: f32, dice: &mut Dice) {
    let size = [dice.range(8.0, 20.0), dice.range(6.0, 12.0)];
    let mesh = built(|mesh, dice| house(mesh, size, false, dice), dice);
    let across = side * (yard.ground.edge_m + dice.range(8.0, 28.0));
    let yaw = half_turn(side < 0.0) + dice.normal(0.0, 0.1);
    yard.put(Thing::Building, &mesh, along, across, yaw);
}

/// A house whose front is the plane y = 0 and whose depth extends to +y: windows and doors are niches, with plinth, downpipes, stairs, roof.
fn house(mesh: &mut Mesh, [length, depth]: [f32; 2], hall: bool, dice: &mut Dice) {
    let plaster = solid(dice.range(0.25, 0.6));
    let floors = if hall { 1 } else { dice.whole(1, 4) };
    let [low, high] = if hall { [4.5, 8.0] } else { [2.7, 3.3] };
    let floor_m = dice.range(low, high);
    let height = floors as f32 * floor_m + 0.4;
    let body = v(length, depth - 0.3, height + 1.0);
    let body_at = v(0.0, depth / 2.0 + 0.15, height / 2.0 - 0.5);
    mesh.block(body_at, body, plaster);
    let bays = (length / if hall { 4.5 } else { 2.4 }).round().max(1.0) as usize;
    let bay = length / bays as f32;
    let door = dice.whole(0, bays - 1);
    for floor in 0..floors {
        let base = floor as f32 * floor_m;
        let bottom = if floor == 0 { -1.0 } else { base };
        let eave = if floor + 1 == floors { 0.4 } else { 0.0 };
        let heights = [bottom, base, base + floor_m + eave];
        for i in 0..bays {
            let left = -length / 2.0 + i as f32 * bay;
            let is_door = floor == 0 && i == door;
            panel(mesh, [left, bay], heights, floor_m, is_door, plaster, dice);
        }
    }
    if !hall || dice.chance(0.3) {
        roof(mesh, length, depth, height, dice);
    }
    for end in [-0.48, 0.47] {
        if dice.chance(0.6) {
            let ends = [0.0, height].map(|z| v(end * length, -0.07, z));
            mesh.rod(ends, 0.06, 5, solid(0.3));
        }
    }
    if dice.chance(0.35) {
        let x = dice.spread(length * 0.35);
        for step in 0..3 {
            let rise = 0.17 * step as f32;
            let at = v(x, -0.15 - 0.28 * (2 - step) as f32, 0.09 + rise);
            mesh.block(at, v(1.4, 0.3, 0.18 + rise), solid(0.35));
        }
    }
}

/// A piece of the front; its opening is 10 cm deep and has a pane or a blind. `bay`: left end and width; `z`: bottom, floor and top.
fn panel(
    mesh: &mut Mesh,
    [left, bay]: [f32; 2],
    [bottom, base, top]: [f32; 3],
    floor_m: f32,
    is_door: bool,
    plaster: Surface,
    dice: &mut Dice,
) {
    let door_or_window = [[0.48, 0.32, 0.8], [0.5, 0.02, 0.72]];
    let [width, low, high] = door_or_window[usize::from(is_door)];
    let half = bay * width / 2.0;
    let (x0, x1) = (left + bay / 2.0 - half, left + bay / 2.0 + half);
    let (z0, z1) = (base + low * floor_m, base + high * floor_m);
    mesh.pane([left, x0], 0.0, [bottom, top], plaster);
    mesh.pane([x1, left + bay], 0.0, [bottom, top], plaster);
    mesh.pane([x0, x1], 0.0, [bottom, z0], plaster);
    mesh.pane([x0, x1], 0.0, [z1, top], plaster);
    let pane = if dice.chance(0.4) { GLASS } else { solid(0.35) };
    mesh.pane([x0, x1], 0.1, [z0, z1], pane);
    let sill = v((x0 + x1) / 2.0, -0.04, z0 - 0.03);
    mesh.block(sill, v(x1 - x0 + 0.1, 0.16, 0.05), plaster);
}

fn roof(mesh: &mut Mesh, length: f32, depth: f32, height: f32, dice: &mut Dice) {
    let rise = depth * dice.range(0.2, 0.5);
    let half = length / 2.0 + 0.3;
    let tiles = solid(0.25);
    let eave = v(0.0, -0.4, height);
    let ridge = v(0.0, depth / 2.0, height + rise);
    let rear = v(0.0, depth + 0.2, height);
    let (a, b) = (v(half, 0.0, 0.0), v(-half, 0.0, 0.0));
    mesh.quad([eave + b, eave + a, ridge + a, ridge + b], tiles);
    mesh.quad([ridge + b, ridge + a, rear + a, rear + b], tiles);
    if dice.chance(0.5) {
        let x = dice.spread(length * 0.3);
        let chimney = v(x, depth * 0.4, height + rise * 0.8);
        mesh.block(chimney, v(0.6, 0.6, 1.6), solid(0.25));
    }
}

/// A garden wall with pillars, sometimes with a gap.
fn wall(mesh: &mut Mesh, length: f32, dice: &mut Dice) {
    let height = dice.range(0.6, 2.6);
    let stone = solid(dice.range(0.25, 0.5));
    let bays = (length / dice.range(2.5, 4.0)).ceil() as usize;
    let bay = length / bays as f32;
    for i in 0..bays {
        let x = -length / 2.0 + (i as f32 + 0.5) * bay;
        if dice.chance(0.93) {
            let panel = v(bay - 0.3, 0.22, height + 0.4);
            mesh.block(v(x, 0.0, height / 2.0 - 0.2), panel, stone);
        }
        let pillar = v(x - bay / 2.0, 0.0, height / 2.0 - 0.15);
        mesh.block(pillar, v(0.35, 0.35, height + 0.5), stone);
    }
}

/// Posts with wire mesh (porous) or with pales.
fn fence(mesh: &mut Mesh, length: f32, dice: &mut Dice) {
    let height = dice.range(0.9, 2.2);
    let wire = dice.chance(0.55);
    let wood = solid(0.35);
    let bays = (length / 2.5).ceil() as usize;
    let bay = length / bays as f32;
    for i in 0..=bays {
        let x = -length / 2.0 + i as f32 * bay;
        mesh.block(v(x, 0.0, height / 2.0), v(0.08, 0.08, height), wood);
    }
    let ends = [-length / 2.0, length / 2.0];
    if wire {
        mesh.pane(ends, 0.0, [0.05, height], porous(0.3, 0.7));
        return;
    }
    for z in [0.3 * height, 0.85 * height] {
        mesh.block(up(z), v(length, 0.04, 0.1), wood);
    }
    mesh.pane(ends, 0.04, [0.1, height], porous(0.35, 0.35));
}

/// A clipped hedge: a rough porous block around a denser core.
fn hedge(mesh: &mut Mesh, length: f32, dice: &mut Dice) {
    let (height, width) = (dice.range(0.8, 2.2), dice.range(0.6, 1.2));
    let sections = (length / 0.9).ceil() as usize;
    for (scale, leaves) in [(1.0, porous(0.35, 0.45)), (0.6, solid(0.3))] {
        let (w, h) = (width / 2.0 * scale, height * (0.5 + 0.5 * scale));
        let ring = |i: usize| {
            let x = length * (i as f32 / sections as f32 - 0.5);
            let right =
                [(1.0, 0.0), (1.1, h * 0.6), (0.8, h)].map(|(share, z)| v(x, -w * share, z));
            let mut outline = mirrored(&right);
            for point in &mut outline {
                *point += v(0.0, dice.spread(0.09), dice.spread(0.09));
            }
            outline
        };
        let rings: Vec<_> = (0..=sections).map(ring).collect();
        mesh.loft(&rings, false, |_, _| leaves);
    }
}
