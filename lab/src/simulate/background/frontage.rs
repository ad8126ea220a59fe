//! What stands along both sides of a road: houses, walls, fences, hedges; and houses further back.

use super::super::mesh::{GLASS, Mesh, Surface, porous, solid, v};
use super::super::random::Dice;
use super::{Place, Thing, Yard};

/// Walks along each side in pieces of 7 to 24 m.
pub(super) fn place(yard: &mut Yard<'_, '_>, dice: &mut Dice) {
    let [low, high] = yard.along_m();
    for side in [-1.0f32, 1.0] {
        let mut along = low - dice.range(0.0, 8.0);
        let setback = match yard.ground.place {
            Place::Urban => dice.range(0.1, 2.5),
            Place::Suburb => dice.range(1.0, 6.0),
            Place::Industrial => dice.range(2.0, 10.0),
            Place::Plaza => dice.range(1.0, 6.0),
        };
        while along < high {
            let length = dice.range(7.0, 24.0);
            let middle = along + length / 2.0;
            let in_crossing = yard
                .ground
                .crossing
                .is_some_and(|[at, half]| (middle - at).abs() < half + length / 2.0);
            if !in_crossing {
                piece(
                    yard,
                    side,
                    middle,
                    length,
                    setback + dice.spread(0.6).max(-setback),
                    dice,
                );
            }
            along += length
                + if dice.chance(0.4) {
                    dice.range(1.0, 6.0)
                } else {
                    0.0
                };
        }
    }
}

fn piece(
    yard: &mut Yard<'_, '_>,
    side: f32,
    along: f32,
    length: f32,
    setback: f32,
    dice: &mut Dice,
) {
    // Houses, wall, fence, hedge, thicket, open.
    let weights = match yard.ground.place {
        Place::Urban => [0.5, 0.08, 0.07, 0.08, 0.19, 0.08],
        Place::Suburb => [0.2, 0.07, 0.1, 0.15, 0.42, 0.06],
        Place::Industrial => [0.34, 0.09, 0.2, 0.05, 0.2, 0.12],
        Place::Plaza => [0.34, 0.09, 0.11, 0.1, 0.26, 0.1],
    };
    let edge = yard.ground.edge_m;
    let inner = if side > 0.0 {
        0.0
    } else {
        std::f32::consts::PI
    };
    match dice.weighted(&weights) {
        0 => {
            let depth = dice.range(6.0, 13.0);
            let mesh = house(length * 0.97, depth, yard.is(Place::Industrial), dice);
            // The facade (local y = 0) faces the road; a second row stands further back when something is in the way.
            if !yard.put(
                Thing::Building,
                &mesh,
                along,
                side * (edge + setback),
                inner,
            ) {
                yard.put(
                    Thing::Building,
                    &mesh,
                    along,
                    side * (edge + setback + dice.range(8.0, 16.0)),
                    inner,
                );
            }
        }
        choice => {
            let line = side * (edge + dice.range(0.15, 0.8));
            let (thing, mesh) = match choice {
                1 => (Thing::Wall, wall(length, dice)),
                2 => (Thing::Fence, fence(length, dice)),
                3 => (Thing::Hedge, hedge(length, dice)),
                4 => (Thing::Bush, super::vegetation::thicket(length, dice)),
                _ => return back_house(yard, side, along, dice),
            };
            yard.put(thing, &mesh, along, line, inner);
            for _ in 0..dice.whole(0, 4) {
                // What grows behind it.
                let bush = super::vegetation::bush(dice);
                yard.put(
                    Thing::Bush,
                    &bush,
                    along + dice.spread(length / 2.0),
                    line + side * dice.range(0.9, 3.5),
                    0.0,
                );
            }
            if dice.chance(0.6) {
                back_house(yard, side, along, dice);
            }
        }
    }
}

fn back_house(yard: &mut Yard<'_, '_>, side: f32, along: f32, dice: &mut Dice) {
    let length = dice.range(8.0, 20.0);
    let mesh = house(length, dice.range(6.0, 12.0), false, dice);
    let inner = if side > 0.0 {
        0.0
    } else {
        std::f32::consts::PI
    };
    let across = side * (yard.ground.edge_m + dice.range(8.0, 28.0));
    yard.put(
        Thing::Building,
        &mesh,
        along,
        across,
        inner + dice.normal(0.0, 0.1),
    );
}

/// A house whose front is the plane y = 0 and whose depth goes to +y: windows and doors are niches, with plinth, downpipes, stairs, roof.
fn house(length: f32, depth: f32, hall: bool, dice: &mut Dice) -> Mesh {
    let plaster = solid(dice.range(0.25, 0.6));
    let floors = if hall { 1 } else { dice.whole(1, 4) };
    let floor_m = if hall {
        dice.range(4.5, 8.0)
    } else {
        dice.range(2.7, 3.3)
    };
    let height = floors as f32 * floor_m + 0.4;
    let mut mesh = Mesh::default();
    mesh.block(
        v(0.0, depth / 2.0 + 0.15, height / 2.0 - 0.5),
        v(length, depth - 0.3, height + 1.0),
        plaster,
    );
    facade(&mut mesh, length, floors, floor_m, hall, plaster, dice);
    if !hall || dice.chance(0.3) {
        roof(&mut mesh, length, depth, height, dice);
    }
    for end in [-0.48, 0.47] {
        if dice.chance(0.6) {
            mesh.tube(
                [v(end * length, -0.07, 0.0), v(end * length, -0.07, height)],
                [0.06, 0.06],
                5,
                solid(0.3),
            );
        }
    }
    if dice.chance(0.35) {
        let x = dice.spread(length * 0.35);
        for step in 0..3 {
            mesh.block(
                v(
                    x,
                    -0.15 - 0.28 * (2 - step) as f32,
                    0.09 + 0.17 * step as f32,
                ),
                v(1.4, 0.3, 0.18 + 0.17 * step as f32),
                solid(0.35),
            );
        }
    }
    mesh
}

/// The front as a grid of panels; openings are set back by 10 to 30 cm and hold a pane or a blind.
fn facade(
    mesh: &mut Mesh,
    length: f32,
    floors: usize,
    floor_m: f32,
    hall: bool,
    plaster: Surface,
    dice: &mut Dice,
) {
    let bays = (length / if hall { 4.5 } else { 2.4 }).round().max(1.0) as usize;
    let bay = length / bays as f32;
    let door = dice.whole(0, bays - 1);
    for floor in 0..floors {
        let base = floor as f32 * floor_m;
        for i in 0..bays {
            let left = -length / 2.0 + i as f32 * bay;
            let open = if floor == 0 && i == door {
                [0.5, 0.02, 0.72]
            } else {
                [0.48, 0.32, 0.8]
            };
            let half = bay * open[0] / 2.0;
            let (x0, x1) = (left + bay / 2.0 - half, left + bay / 2.0 + half);
            let (z0, z1) = (base + open[1] * floor_m, base + open[2] * floor_m);
            let (bottom, top) = (
                if floor == 0 { -1.0 } else { base },
                base + floor_m + if floor + 1 == floors { 0.4 } else { 0.0 },
            );
            let mut panel = |a: f32, b: f32, low: f32, high: f32| {
                mesh.quad(
                    [
                        v(a, 0.0, low),
                        v(b, 0.0, low),
                        v(b, 0.0, high),
                        v(a, 0.0, high),
                    ],
                    plaster,
                )
            };
            panel(left, x0, bottom, top);
            panel(x1, left + bay, bottom, top);
            panel(x0, x1, bottom, z0);
            panel(x0, x1, z1, top);
            let pane = if dice.chance(0.4) { GLASS } else { solid(0.35) };
            mesh.quad(
                [
                    v(x0, 0.1, z0),
                    v(x1, 0.1, z0),
                    v(x1, 0.1, z1),
                    v(x0, 0.1, z1),
                ],
                pane,
            );
            mesh.block(
                v((x0 + x1) / 2.0, -0.04, z0 - 0.03),
                v(x1 - x0 + 0.1, 0.16, 0.05),
                plaster,
            );
        }
    }
}

fn roof(mesh: &mut Mesh, length: f32, depth: f32, height: f32, dice: &mut Dice) {
    let rise = depth * dice.range(0.2, 0.5);
    let half = length / 2.0 + 0.3;
    let tiles = solid(0.25);
    let (eave, ridge, rear) = (
        v(0.0, -0.4, height),
        v(0.0, depth / 2.0, height + rise),
        v(0.0, depth + 0.2, height),
    );
    let (a, b) = (v(half, 0.0, 0.0), v(-half, 0.0, 0.0));
    mesh.quad([eave + b, eave + a, ridge + a, ridge + b], tiles);
    mesh.quad([ridge + b, ridge + a, rear + a, rear + b], tiles);
    if dice.chance(0.5) {
        mesh.block(
            v(dice.spread(length * 0.3), depth * 0.4, height + rise * 0.8),
            v(0.6, 0.6, 1.6),
            solid(0.25),
        );
    }
}

/// A garden wall with pillars, now and then a gap.
fn wall(length: f32, dice: &mut Dice) -> Mesh {
    let height = dice.range(0.6, 2.6);
    let stone = solid(dice.range(0.25, 0.5));
    let mut mesh = Mesh::default();
    let bays = (length / dice.range(2.5, 4.0)).ceil() as usize;
    let bay = length / bays as f32;
    for i in 0..bays {
        let x = -length / 2.0 + (i as f32 + 0.5) * bay;
        if dice.chance(0.93) {
            mesh.block(
                v(x, 0.0, height / 2.0 - 0.2),
                v(bay - 0.3, 0.22, height + 0.4),
                stone,
            );
        }
        mesh.block(
            v(x - bay / 2.0, 0.0, height / 2.0 - 0.15),
            v(0.35, 0.35, height + 0.5),
            stone,
        );
    }
    mesh
}

/// Posts with wire mesh (porous) or with pales.
fn fence(length: f32, dice: &mut Dice) -> Mesh {
    let height = dice.range(0.9, 2.2);
    let wire = dice.chance(0.55);
    let wood = solid(0.35);
    let mut mesh = Mesh::default();
    let bays = (length / 2.5).ceil() as usize;
    let bay = length / bays as f32;
    for i in 0..=bays {
        let x = -length / 2.0 + i as f32 * bay;
        mesh.block(v(x, 0.0, height / 2.0), v(0.08, 0.08, height), wood);
    }
    if wire {
        let (a, b) = (-length / 2.0, length / 2.0);
        mesh.quad(
            [
                v(a, 0.0, 0.05),
                v(b, 0.0, 0.05),
                v(b, 0.0, height),
                v(a, 0.0, height),
            ],
            porous(0.3, 0.7),
        );
    } else {
        for z in [0.3 * height, 0.85 * height] {
            mesh.block(v(0.0, 0.0, z), v(length, 0.04, 0.1), wood);
        }
        mesh.quad(
            [
                v(-length / 2.0, 0.04, 0.1),
                v(length / 2.0, 0.04, 0.1),
                v(length / 2.0, 0.04, height),
                v(-length / 2.0, 0.04, height),
            ],
            porous(0.35, 0.35),
        );
    }
    mesh
}

/// A clipped hedge: a rough porous block around a denser core.
fn hedge(length: f32, dice: &mut Dice) -> Mesh {
    let (height, width) = (dice.range(0.8, 2.2), dice.range(0.6, 1.2));
    let mut mesh = Mesh::default();
    let sections = (length / 0.9).ceil() as usize;
    for (scale, leaves) in [(1.0, porous(0.35, 0.45)), (0.6, solid(0.3))] {
        let rings: Vec<Vec<_>> = (0..=sections)
            .map(|i| {
                let x = length * (i as f32 / sections as f32 - 0.5);
                let (w, h) = (width / 2.0 * scale, height * (0.5 + 0.5 * scale));
                [
                    (-w, 0.0),
                    (-w * 1.1, h * 0.6),
                    (-w * 0.8, h),
                    (w * 0.8, h),
                    (w * 1.1, h * 0.6),
                    (w, 0.0),
                ]
                .map(|(y, z)| v(x, y + dice.spread(0.09), z + dice.spread(0.09)))
                .to_vec()
            })
            .collect();
        mesh.loft(&rings, false, |_, _| Some(leaves));
    }
    mesh
}
