//! Cars in several body styles, and vans: a lofted lower body with wheel arches, a glazed cabin, wheels, seats, mirrors.

use super::super::Family;
use super::super::mesh::{GLASS, INTERIOR, Mesh, Surface, V3, solid, v};
use super::super::random::Dice;
use super::vehicle::{axle, occupant, paint, plate_and_lamps, seat};
use super::{Model, fit};

/// Side profile of a body style. Positions along x are fractions of the length (front +0.5), heights fractions of the height.
#[derive(Clone, Copy)]
struct Profile {
    cowl: f32,
    roof_front: f32,
    roof_rear: f32,
    deck: f32,
    nose: f32,
    hood: f32,
    belt: f32,
    tail: f32,
    /// Share of the side behind the front doors that is sheet metal.
    panelled: bool,
    /// An open load bed behind the cabin.
    bed: bool,
    /// Roof width over body width.
    roof_width: f32,
}

/// Cowl, roof's front and rear, deck; nose, hood, belt, tail; width of the roof.
const fn profile(values: [f32; 9]) -> Profile {
    let [
        cowl,
        roof_front,
        roof_rear,
        deck,
        nose,
        hood,
        belt,
        tail,
        roof_width,
    ] = values;
    Profile {
        cowl,
        roof_front,
        roof_rear,
        deck,
        nose,
        hood,
        belt,
        tail,
        panelled: false,
        bed: false,
        roof_width,
    }
}

const SEDAN: Profile = profile([0.20, 0.05, -0.21, -0.36, 0.46, 0.62, 0.63, 0.66, 0.80]);
const HATCH: Profile = profile([0.24, 0.08, -0.36, -0.46, 0.46, 0.62, 0.63, 0.6, 0.80]);
const ESTATE: Profile = profile([0.21, 0.07, -0.42, -0.48, 0.46, 0.62, 0.63, 0.6, 0.80]);
const SUV: Profile = profile([0.23, 0.10, -0.40, -0.475, 0.5, 0.6, 0.61, 0.58, 0.85]);
const MINI: Profile = profile([0.30, 0.13, -0.38, -0.47, 0.44, 0.58, 0.58, 0.55, 0.80]);
const COUPE: Profile = profile([0.17, 0.0, -0.18, -0.40, 0.46, 0.62, 0.65, 0.68, 0.80]);
const PICKUP: Profile = Profile {
    bed: true,
    ..profile([0.22, 0.10, -0.06, -0.10, 0.52, 0.6, 0.6, 0.6, 0.80])
};
const MINIBUS: Profile = profile([0.38, 0.26, -0.47, -0.495, 0.36, 0.5, 0.52, 0.5, 0.88]);

/// A passenger car with KITTI's or UDI's sizes.
pub(super) fn car(family: Family, dice: &mut Dice) -> Model {
    // (weight, profile, change of length, of height): the changes cancel in the mean.
    let styles = [
        (0.26, SEDAN, 0.35, -0.05),
        (0.26, HATCH, -0.12, -0.03),
        (0.15, ESTATE, 0.42, -0.03),
        (0.12, SUV, 0.2, 0.17),
        (0.15, MINI, -0.65, 0.0),
        (0.04, COUPE, 0.0, -0.16),
        (0.02, PICKUP, 0.6, 0.2),
    ];
    let (_, profile, longer, higher) = styles[dice.weighted(&styles.map(|s| s.0))];
    let base = match family {
        Family::SimKitti => v(3.84, 1.62, 1.53),
        Family::SimUdi => v(4.43, 1.85, 1.55),
    };
    let length = dice.normal(base.x + longer, 0.26).max(2.6);
    let width = dice.normal(base.y + 0.08 * longer, 0.085);
    let height = dice.normal(base.z + higher, 0.1).max(1.2);
    body(profile, v(length, width, height), dice)
}

/// A van: cab forward, often without rear windows, sometimes with a roof rack.
pub(super) fn van(dice: &mut Dice) -> Model {
    let profile = Profile {
        panelled: dice.chance(0.6),
        ..MINIBUS
    };
    let length = dice.normal(5.07, 0.6).max(3.8);
    let width = dice.normal(1.9, 0.14);
    let height = dice.normal(2.21, 0.26).max(1.75);
    body(profile, v(length, width, height), dice)
}

fn body(nominal: Profile, size: V3, dice: &mut Dice) -> Model {
    let profile = vary(nominal, dice);
    let colour = paint(dice);
    let wheel_radius = dice.range(0.29, 0.35) * (size.z / 1.53).clamp(0.95, 1.12);
    let mut mesh = Mesh::default();
    lower_body(&mut mesh, profile, size, wheel_radius, colour);
    cabin(&mut mesh, profile, size, colour);
    for (end, share) in [(1.0, 0.45), (-1.0, 0.5)] {
        let z = share * size.z * 1.53 / size.z.max(1.53);
        plate_and_lamps(&mut mesh, end * size.x / 2.0, z, size.y, end);
    }
    mesh.roughen(0.007, dice);
    interior(&mut mesh, profile, size, dice);
    let track = size.y / 2.0 - 0.15;
    for x in wheel_positions(size.x) {
        axle(&mut mesh, x, track, wheel_radius, 0.2);
    }
    fit(&mut mesh, size);
    let mut mirrors = Mesh::default();
    let x = (profile.cowl - 0.04) * size.x;
    let left = v(x, size.y / 2.0 + 0.08, profile.belt * size.z + 0.06);
    mirrors.twins(left, v(0.12, 0.18, 0.13), colour);
    Model::new(mesh, &mirrors)
}

/// Small changes of a profile, so that no two cars of a style agree.
fn vary(p: Profile, dice: &mut Dice) -> Profile {
    let mut near = |value: f32, half: f32| value + dice.spread(half);
    Profile {
        cowl: near(p.cowl, 0.02),
        roof_front: near(p.roof_front, 0.02),
        roof_rear: near(p.roof_rear, 0.02),
        deck: near(p.deck, 0.008),
        nose: near(p.nose, 0.03),
        hood: near(p.hood, 0.03),
        belt: near(p.belt, 0.02),
        tail: near(p.tail, 0.03),
        roof_width: near(p.roof_width, 0.04),
        ..p
    }
}

fn wheel_positions(length: f32) -> [f32; 2] {
    [0.31 * length, -0.30 * length]
}

/// Half width of the body at this fraction of the length: drawn in at nose and tail.
fn plan_half_width(fraction: f32, width: f32) -> f32 {
    let at = [0.2, 0.34, 0.44, 0.47, 0.487, 0.5];
    let share = [1.0, 0.985, 0.94, 0.88, 0.78, 0.5];
    let knots: [(f32, f32); 6] = std::array::from_fn(|i| (at[i], share[i]));
    width / 2.0 * interpolate(&knots, fraction.abs().max(0.2))
}

/// Cross-sections from tail to nose. In the cabin the top is open down to the seats' height.
fn lower_body(mesh: &mut Mesh, p: Profile, size: V3, wheel_radius: f32, colour: Surface) {
    let sill = 0.19;
    let arch = (wheel_radius + 0.06) / size.x;
    let [front, rear] = wheel_positions(size.x).map(|x| x / size.x);
    let top_at = |f: f32| {
        let knots = [
            (-0.5, p.tail * 0.72),
            (-0.487, p.tail * 0.86),
            (-0.47, p.tail),
            (p.deck, p.belt),
            (p.cowl, p.belt),
            (p.cowl + 0.02, p.hood),
            (0.44, p.nose),
            (0.47, p.nose * 0.93),
            (0.487, p.nose * 0.82),
            (0.5, p.nose * 0.68),
        ];
        interpolate(&knots, f) * size.z
    };
    let mut stations = vec![-0.5, -0.487, -0.47, -0.44, 0.44, 0.47, 0.487, 0.5];
    for wheel in [rear, front] {
        stations.extend([-1.0, -0.6, 0.6, 1.0].map(|share| wheel + share * arch));
    }
    stations.extend([p.deck, p.roof_rear, p.cowl, p.cowl + 0.02]);
    stations.sort_by(f32::total_cmp);
    let ring = |f: &f32| {
        let f = *f;
        let in_arch = [front, rear].iter().any(|w| (f - w).abs() < 0.8 * arch);
        let bottom = if in_arch {
            2.0 * wheel_radius + 0.03
        } else {
            sill + 0.8 * (f.abs() - 0.42).max(0.0) * size.x * 0.5
        };
        let top = top_at(f).max(bottom + 0.05);
        let half = plan_half_width(f, size.y);
        let hollow = (f > p.deck + 0.01 && f < p.cowl - 0.01) || (p.bed && f < p.deck && f > -0.48);
        let middle = if hollow { 0.42 * size.z } else { top + 0.02 };
        let waist = bottom + 0.55 * (top - bottom);
        let x = f * size.x;
        let side = |s: f32| {
            [
                v(x, s * half * 0.87, bottom),
                v(x, s * half, waist),
                v(x, s * half * 0.93, top - 0.04),
                v(x, s * half * 0.84, top),
            ]
        };
        let mut ring: Vec<V3> = side(1.0).to_vec();
        ring.push(v(x, 0.0, middle));
        ring.extend(side(-1.0).into_iter().rev());
        ring
    };
    let rings: Vec<Vec<V3>> = stations.iter().map(ring).collect();
    mesh.hull(&rings, colour);
}

/// Pillars, windows and roof: three rings (belt, window top, roof) of sixteen points.
fn cabin(mesh: &mut Mesh, p: Profile, size: V3, colour: Surface) {
    // Along each side: pillar, window, pillar, window, pillar.
    let cuts = [0.0, 0.07, 0.46, 0.51, 0.88, 1.0];
    let ring = |height: f32, blend: f32, inset: f32| -> Vec<V3> {
        let front = p.cowl + (p.roof_front - p.cowl) * blend;
        let rear = p.deck + (p.roof_rear - p.deck) * blend;
        let half = size.y / 2.0 * (0.89 + (p.roof_width - 0.89) * blend) - inset;
        let side = |s: f32| {
            cuts.map(|c| {
                v(
                    (front + (rear - front) * c) * size.x,
                    s * half * (1.0 - 0.05 * (2.0 * c - 1.0).abs()),
                    height * size.z,
                )
            })
        };
        let mut points: Vec<V3> = side(1.0).to_vec();
        points.extend(side(-1.0).into_iter().rev());
        points
    };
    let rings = [
        ring(p.belt, 0.0, 0.0),
        ring(0.92, 0.86, 0.0),
        ring(0.985, 1.0, 0.02),
    ];
    let panelled = p.panelled;
    mesh.loft(&rings, true, |level, point| {
        let window = match point {
            1 | 5 | 9 | 11 => true,
            3 | 7 => !panelled,
            _ => false,
        };
        Some(if level == 0 && window { GLASS } else { colour })
    });
    let [.., roof] = rings;
    let lid: Vec<V3> = (roof.iter().map(|q| v(q.x * 0.98, q.y * 0.6, size.z))).collect();
    mesh.loft(&[roof, lid.clone()], true, |_, _| Some(colour));
    mesh.cap(&lid, colour);
}

fn interior(mesh: &mut Mesh, p: Profile, size: V3, dice: &mut Dice) {
    let floor = 0.32 * size.z;
    let cabin_m = (p.cowl - p.deck) * size.x;
    let front_x = p.cowl * size.x - 0.42 * cabin_m.min(2.4);
    for side in [-1.0, 1.0] {
        seat(mesh, v(front_x, side * size.y * 0.21, floor), 0.5);
    }
    if cabin_m > 1.8 && !p.panelled {
        seat(mesh, v(front_x - 0.85, 0.0, floor), size.y * 0.7);
    }
    let dash = v(p.cowl * size.x - 0.25, 0.0, p.belt * size.z - 0.12);
    mesh.block(dash, v(0.4, size.y * 0.8, 0.2), INTERIOR);
    if dice.chance(0.35) {
        occupant(mesh, v(front_x, size.y * 0.21, floor + 0.15), dice);
    }
    if p.panelled {
        let wall = v(front_x - 0.5, 0.0, 0.55 * size.z);
        mesh.block(wall, v(0.04, size.y * 0.85, 0.8 * size.z), solid(0.3));
    }
}

fn interpolate(knots: &[(f32, f32)], at: f32) -> f32 {
    for pair in knots.windows(2) {
        let ((x0, y0), (x1, y1)) = (pair[0], pair[1]);
        if at <= x1 {
            return y0 + (y1 - y0) * ((at - x0) / (x1 - x0).max(1e-6)).clamp(0.0, 1.0);
        }
    }
    knots.last().map_or(0.0, |k| k.1)
}
