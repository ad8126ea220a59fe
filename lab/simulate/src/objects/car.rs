//! Cars in several body styles, and vans: a lofted lower body with wheel arches, a glazed cabin, wheels, seats, mirrors.

use super::super::mesh::{GLASS, INTERIOR, Mesh, Surface, V3, mirrored, solid, v};
use super::vehicle::{axle, occupant, paint, plate_and_lamps, seat};
use crate::{Family, objects::Model, random::Dice};

/// Side profile of a body style.
#[derive(Clone, Copy)]
struct Profile {
    /// Cowl, front and rear of the roof, deck: fractions of the length, front +0.5.
    along: [f32; 4],
    /// Nose, hood, belt, tail: fractions of the height.
    heights: [f32; 4],
    /// Roof width over body width.
    roof_width: f32,
    /// Whether the side behind the front doors is sheet metal.
    panelled: bool,
    /// Whether there is an open load bed behind the cabin.
    bed: bool,
    /// Whether the body has belt height up to the deck.
    upright: bool,
}

/// The underside between the wheels, and its rise towards nose and tail.
#[derive(Clone, Copy)]
struct Underside {
    middle_m: f32,
    /// The underside rises from this fraction of the length on.
    from: f32,
    /// Rise per metre, at the nose and at the tail.
    slopes: [f32; 2],
}

const UNDERSIDE: Underside = Underside { middle_m: 0.19, from: 0.42, slopes: [0.4; 2] };

/// A nominal profile: `along`, `heights` and `roof_width`.
type Style = ([f32; 4], [f32; 4], f32);

const SEDAN: Style = ([0.20, 0.05, -0.21, -0.36], [0.46, 0.62, 0.63, 0.66], 0.80);
const HATCH: Style = ([0.24, 0.08, -0.36, -0.46], [0.46, 0.62, 0.63, 0.6], 0.80);
const ESTATE: Style = ([0.21, 0.07, -0.42, -0.48], [0.46, 0.62, 0.63, 0.6], 0.80);
const SUV: Style = ([0.23, 0.10, -0.40, -0.475], [0.5, 0.6, 0.61, 0.58], 0.85);
const MINI: Style = ([0.30, 0.13, -0.38, -0.47], [0.44, 0.58, 0.58, 0.55], 0.80);
const COUPE: Style = ([0.17, 0.0, -0.18, -0.40], [0.46, 0.62, 0.65, 0.68], 0.80);
const PICKUP: Style = ([0.22, 0.10, -0.06, -0.10], [0.52, 0.6, 0.6, 0.6], 0.80);
/// Positions of rear window and tail of a car with an upright tail, fractions of the length.
const UPRIGHT: [f32; 2] = [-0.475, -0.488];
/// Maximum share of the shift towards `UPRIGHT`.
const TAIL_SHARE: f32 = 0.7;
const MINIBUS: Style = ([0.38, 0.26, -0.47, -0.495], [0.36, 0.5, 0.52, 0.5], 0.88);

/// A passenger car with KITTI's or UDI's sizes.
pub(super) fn car(family: Family, dice: &mut Dice) -> Model {
    // (weight, style, change of length, change of height): the mean of the changes is zero.
    let styles = [
        (0.26, SEDAN, 0.35, -0.05),
        (0.26, HATCH, -0.12, -0.03),
        (0.15, ESTATE, 0.42, -0.03),
        (0.12, SUV, 0.2, 0.17),
        (0.15, MINI, -0.65, 0.0),
        (0.04, COUPE, 0.0, -0.16),
        (0.02, PICKUP, 0.6, 0.2),
    ];
    let (_, mut style, longer, higher) = styles[dice.weighted(&styles.map(|s| s.0))];
    let bed = style == PICKUP;
    let upright = family == Family::SimAny && [HATCH, ESTATE, SUV, MINI].contains(&style);
    if upright {
        // Rear windows lean by 10 to 35 degrees: from behind, many cars are a single face.
        let share = dice.range(0.0, TAIL_SHARE);
        for (along, upright) in style.0[2..].iter_mut().zip(UPRIGHT) {
            *along += share * (upright - *along);
        }
    }
    let base = match family {
        Family::SimKitti => v(3.84, 1.62, 1.53),
        Family::SimUdi => v(4.43, 1.85, 1.55),
        Family::SimAny => v(4.05, 1.71, 1.54),
    };
    let length = dice.normal(base.x + longer, 0.26).max(2.6);
    let width = dice.normal(base.y + 0.08 * longer, 0.085);
    let height = dice.normal(base.z + higher, 0.1).max(1.2);
    // Rays pass below real cars, most of all below their tails.
    let underside = match family {
        Family::SimAny => Underside {
            middle_m: dice.range(0.14, 0.24),
            from: 0.38,
            slopes: [dice.range(0.15, 0.45), dice.range(0.2, 0.5)],
        },
        _ => UNDERSIDE,
    };
    let size = v(length, width, height);
    body(style, [false, bed, upright], underside, size, dice)
}

/// A van: cab forward, often without rear windows.
pub(super) fn van(dice: &mut Dice) -> Model {
    let panelled = dice.chance(0.6);
    let length = dice.normal(5.07, 0.6).max(3.8);
    let width = dice.normal(1.9, 0.14);
    let size = v(length, width, dice.normal(2.21, 0.26).max(1.75));
    body(MINIBUS, [panelled, false, false], UNDERSIDE, size, dice)
}

/// The vehicle of a style, with small random changes, so that no two are equal.
fn body(
    style: Style,
    [panelled, bed, upright]: [bool; 3],
    underside: Underside,
    size: V3,
    dice: &mut Dice,
) -> Model {
    let mut near = |values: [f32; 4], halves: [f32; 4]| -> [f32; 4] {
        std::array::from_fn(|i| values[i] + dice.spread(halves[i]))
    };
    let mut along = near(style.0, [0.02, 0.02, 0.02, 0.008]);
    if upright {
        along[2] = along[2].max(along[3] + 0.003);
    }
    let profile = Profile {
        along,
        heights: near(style.1, [0.03, 0.03, 0.02, 0.03]),
        roof_width: style.2 + dice.spread(0.04),
        panelled,
        bed,
        upright,
    };
    let colour = paint(dice);
    let wheel_radius = dice.range(0.29, 0.35) * (size.z / 1.53).clamp(0.95, 1.12);
    let mut mesh = Mesh::default();
    lower_body(&mut mesh, profile, underside, size, wheel_radius, colour);
    cabin(&mut mesh, profile, size, colour);
    for (end, share) in [(1.0, 0.45), (-1.0, 0.5)] {
        let z = share * size.z * 1.53 / size.z.max(1.53);
        plate_and_lamps(&mut mesh, end * size.x / 2.0, z, size.y, end);
    }
    mesh.roughen(0.007, dice);
    interior(&mut mesh, profile, size, dice);
    for x in wheel_positions(size.x) {
        axle(&mut mesh, x, size.y / 2.0 - 0.15, wheel_radius, 0.2);
    }
    mesh.fit(size);
    let x = (profile.along[0] - 0.04) * size.x;
    let left = v(x, size.y / 2.0 + 0.08, profile.heights[2] * size.z + 0.06);
    Model::with_mirrors(mesh, left, v(0.12, 0.18, 0.13), colour)
}

fn wheel_positions(length: f32) -> [f32; 2] {
    [0.31 * length, -0.30 * length]
}

/// Cross-sections from tail to nose. In the cabin the top is open down to the seats' height.
fn lower_body(
    mesh: &mut Mesh,
    p: Profile,
    under: Underside,
    size: V3,
    wheel_radius: f32,
    colour: Surface,
) {
    let [cowl, _, roof_rear, deck] = p.along;
    let [nose, hood, belt, tail] = p.heights;
    let most = if p.upright { deck - 0.001 } else { 0.0 };
    let tops = [
        (-0.5, tail * 0.72),
        (f32::min(-0.487, most), tail * 0.86),
        (f32::min(-0.47, most), tail),
        (deck, belt),
        (cowl, belt),
        (cowl + 0.02, hood),
        (0.44, nose),
        (0.47, nose * 0.93),
        (0.487, nose * 0.82),
        (0.5, nose * 0.68),
    ];
    // Narrower at nose and tail: (fraction of the length, share of the width).
    let plan = [(0.2, 1.0), (0.34, 0.985), (0.44, 0.94), (0.47, 0.88), (0.487, 0.78), (0.5, 0.5)];
    let arch = (wheel_radius + 0.06) / size.x;
    let wheels = wheel_positions(size.x).map(|x| x / size.x);
    let mut stations = vec![-0.5, -0.487, -0.47, -0.44, 0.44, 0.47, 0.487, 0.5];
    stations.extend([deck, roof_rear, cowl, cowl + 0.02]);
    for wheel in wheels {
        stations.extend([-1.0, -0.6, 0.6, 1.0].map(|share| wheel + share * arch));
    }
    stations.sort_by(f32::total_cmp);
    let ring = |f: f32| {
        let bottom = if wheels.iter().any(|w| (f - w).abs() < 0.8 * arch) {
            2.0 * wheel_radius + 0.03
        } else {
            let slope = under.slopes[usize::from(f < 0.0)];
            under.middle_m + slope * (f.abs() - under.from).max(0.0) * size.x
        };
        let top = (interpolate(&tops, f) * size.z).max(bottom + 0.05);
        let half = size.y / 2.0 * interpolate(&plan, f.abs().max(0.2));
        let hollow = (f > deck + 0.01 && f < cowl - 0.01) || (p.bed && f < deck && f > -0.48);
        let middle = if hollow { 0.42 * size.z } else { top + 0.02 };
        let x = f * size.x;
        let mut ring = mirrored(&[
            v(x, half * 0.87, bottom),
            v(x, half, bottom + 0.55 * (top - bottom)),
            v(x, half * 0.93, top - 0.04),
            v(x, half * 0.84, top),
        ]);
        ring.insert(4, v(x, 0.0, middle));
        ring
    };
    let rings: Vec<Vec<V3>> = stations.into_iter().map(ring).collect();
    mesh.hull(&rings, colour);
}

/// Pillars, windows and roof: three rings (belt, window top, roof) of twelve points.
fn cabin(mesh: &mut Mesh, p: Profile, size: V3, colour: Surface) {
    let [cowl, roof_front, roof_rear, deck] = p.along;
    // Along each side: pillar, window, pillar, window, pillar.
    let cuts = [0.0, 0.07, 0.46, 0.51, 0.88, 1.0];
    let ring = |height: f32, blend: f32, inset: f32| {
        let front = cowl + (roof_front - cowl) * blend;
        let rear = deck + (roof_rear - deck) * blend;
        let half = size.y / 2.0 * (0.89 + (p.roof_width - 0.89) * blend) - inset;
        let point = |cut: f32| {
            let y = half * (1.0 - 0.05 * (2.0 * cut - 1.0).abs());
            v((front + (rear - front) * cut) * size.x, y, height * size.z)
        };
        mirrored(&cuts.map(point))
    };
    let roof = ring(0.985, 1.0, 0.02);
    let rings = [&ring(p.heights[2], 0.0, 0.0), &ring(0.92, 0.86, 0.0), &roof];
    mesh.loft(&rings, true, |level, point| {
        let rear_side = matches!(point, 3 | 7) && !p.panelled;
        let window = rear_side || matches!(point, 1 | 5 | 9 | 11);
        if level == 0 && window { GLASS } else { colour }
    });
    let flat = |q: &V3| v(q.x * 0.98, q.y * 0.6, size.z);
    let lid = roof.iter().map(flat).collect();
    mesh.loft(&[&roof, &lid], true, |_, _| colour);
    mesh.cap(&lid, colour);
}

fn interior(mesh: &mut Mesh, p: Profile, size: V3, dice: &mut Dice) {
    let ([cowl, _, _, deck], belt) = (p.along, p.heights[2]);
    let floor = 0.32 * size.z;
    let cabin_m = (cowl - deck) * size.x;
    let front_x = cowl * size.x - 0.42 * cabin_m.min(2.4);
    for side in [-1.0, 1.0] {
        seat(mesh, v(front_x, side * size.y * 0.21, floor), 0.5);
    }
    if cabin_m > 1.8 && !p.panelled {
        seat(mesh, v(front_x - 0.85, 0.0, floor), size.y * 0.7);
    }
    let dash = v(cowl * size.x - 0.25, 0.0, belt * size.z - 0.12);
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

#[cfg(test)]
mod tests {
    use super::*;
    use parry3d::{query::Ray, query::RayCast, shape::TriMesh};

    #[test]
    fn tails_of_cars_are_closed_below_their_windows() {
        let is_open = |seed: &u64| {
            let car = car(Family::SimAny, &mut Dice::new(&[41, *seed]));
            let mesh = TriMesh::new(car.mesh.vertices.clone(), car.mesh.triangles.clone());
            let mesh = mesh.expect("a mesh");
            // Above any underside, below any window.
            [0.5, 0.52, 0.54].iter().any(|share| {
                let from = v(car.low.x - 1.0, 0.3, share * car.high.z);
                mesh.cast_local_ray(&Ray::new(from, V3::X), 20.0, false).expect("a car") > 1.4
            })
        };
        let open: Vec<u64> = (0..400).filter(is_open).collect();
        // Load beds of pickups.
        assert!(open.len() < 20, "{} of 400: {open:?}", open.len());
    }
}
