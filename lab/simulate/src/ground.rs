//! The ground: a road with crown and kerbs, pavements, banks, slope and waves, as a height function and as triangles.
//!
//! Two frames are used here. Sensor frame: x forward, y left, z up, the sensor at the origin. Road frame: u along the road, v to its left from its
//! middle; the sensor is at u = 0, v = `lane_m`.

use super::mesh::{Mesh, V3, solid, v};
use super::place::{Place, Room, besides_streets};
use super::{Family, random::Dice, sensor::HEIGHT_M};
use std::f32::consts::TAU;

/// Shape of the ground of one scene.
pub(crate) struct Ground {
    pub(crate) place: Place,
    /// Heading of the road in the sensor frame, rad.
    pub(crate) yaw_rad: f32,
    /// Position of the sensor across the road, m.
    pub(crate) lane_m: f32,
    /// Half the carriageway, m.
    pub(crate) half_width_m: f32,
    /// From the middle of the road to the frontage, m.
    pub(crate) edge_m: f32,
    /// A crossing road: its position along the road, and half its width, m.
    pub(crate) crossing: Option<[f32; 2]>,
    /// Walls and a ceiling around the sensor.
    pub(crate) room: Option<Room>,
    kerb_m: f32,
    crown_m: f32,
    bank: [f32; 2],
    slope: [f32; 2],
    waves: [[f32; 4]; 4],
    sensor_height_m: f32,
    /// Roughness of the ground on the road and next to it, m.
    rough_m: [f32; 2],
    /// Maximum slope of an object along an axis.
    steepest: f32,
    /// Distance from a crossing road over which banks rise to their full height, m.
    ramp_m: f32,
}

/// Height, wave vector and phase, m.
fn wave(factor: f32, dice: &mut Dice) -> [f32; 4] {
    let length_m = dice.range(9.0, 50.0);
    let (sin, cos) = dice.range(0.0, TAU).sin_cos();
    let k = TAU / length_m;
    let height = dice.normal(0.0, 0.0016) * length_m * factor;
    [height, k * cos, k * sin, dice.range(0.0, TAU)]
}

/// Rise to the front and to the left of the sensor.
fn slope(family: Family, dice: &mut Dice) -> [f32; 2] {
    match family {
        // The bottoms of KITTI's labels rise by 8 mm per metre: its sensor is pitched down by half a degree.
        Family::SimKitti => [dice.normal(0.008, 0.007), dice.normal(0.0, 0.008)],
        Family::SimUdi => [dice.normal(0.0, 0.009), dice.normal(0.0, 0.009)],
        // The ground tilts relative to the sensor, as with a tilted mount: mostly by less than a degree, sometimes by up to three.
        Family::SimAny if dice.chance(0.2) => [dice.spread(0.05), dice.spread(0.05)],
        Family::SimAny => [dice.normal(0.004, 0.013), dice.normal(0.0, 0.013)],
    }
}

impl Ground {
    /// Draws the ground of a scene.
    pub(crate) fn draw(family: Family, sensor_height_m: Option<f32>, dice: &mut Dice) -> Ground {
        let place = match (dice.weighted(&[0.34, 0.28, 0.2, 0.18]), family) {
            (0, _) => Place::Urban,
            (1, _) => Place::Suburb,
            (2, _) => Place::Industrial,
            (_, Family::SimKitti) if dice.chance(0.6) => Place::Urban,
            _ => Place::Plaza,
        };
        let own_height_m = sensor_height_m.unwrap_or(HEIGHT_M);
        let other = (family == Family::SimAny).then(|| besides_streets(own_height_m, dice));
        let place = other.flatten().unwrap_or(place);
        let room = Room::draw(place, own_height_m, dice);
        let street = place.is_street();
        let half_width_m = if let Some(room) = &room {
            room.half_width_m
        } else if let Some([low, high]) = place.half_width_m() {
            dice.range(low, high)
        } else if family != Family::SimUdi && dice.chance(0.6) {
            // Many residential streets are narrow, also in KITTI.
            dice.range(2.8, 4.5)
        } else {
            dice.range(3.2, 7.5)
        };
        let yaw_deg = match family {
            Family::SimKitti => dice.normal(0.0, 4.0),
            _ if !street => dice.range(-180.0, 180.0),
            _ => dice.normal(0.0, 7.0),
        };
        let mut ground = Ground {
            place,
            yaw_rad: yaw_deg.to_radians(),
            lane_m: match place {
                Place::Plaza | Place::Depot => dice.spread(8.0),
                Place::CarPark => dice.spread(1.5),
                Place::Hall => dice.spread(half_width_m - 4.5),
                Place::Path => dice.spread(0.5 * half_width_m),
                _ => -half_width_m * dice.range(0.3, 0.6),
            },
            half_width_m,
            edge_m: half_width_m
                + match place {
                    Place::Path => dice.range(0.2, 1.0),
                    _ if street => dice.range(1.2, 4.0),
                    _ => 1.0,
                },
            crossing: (street && dice.chance(0.45))
                .then(|| [dice.range(-25.0, 45.0), dice.range(3.0, 5.5)]),
            room,
            kerb_m: if street { dice.range(0.03, 0.15) } else { 0.0 },
            crown_m: dice.range(0.0, 0.1),
            bank: [dice.normal(0.01, 0.025), dice.normal(0.01, 0.025)],
            slope: slope(family, dice),
            waves: std::array::from_fn(|i| wave(if i == 0 { 1.5 } else { 1.0 }, dice)),
            sensor_height_m: sensor_height_m.unwrap_or_else(|| dice.normal(HEIGHT_M, 0.025)),
            rough_m: [0.006, 0.03],
            steepest: 0.06,
            ramp_m: 0.0,
        };
        if family == Family::SimAny {
            ground.vary(dice);
        }
        ground
    }

    /// Floors are flat, rough ground has larger waves, and the ground next to a street often rises.
    fn vary(&mut self, dice: &mut Dice) {
        self.steepest = 0.12;
        self.ramp_m = 12.0;
        let scale = match self.place {
            _ if self.room.is_some() => {
                (self.crown_m, self.bank) = (0.0, [0.0; 2]);
                0.1
            }
            Place::Path => {
                self.rough_m = [dice.range(0.008, 0.03), dice.range(0.03, 0.08)];
                self.bank = [dice.spread(0.12), dice.spread(0.12)];
                dice.range(1.5, 5.0)
            }
            _ => {
                for bank in &mut self.bank {
                    if dice.chance(0.3) {
                        *bank = dice.range(0.04, 0.22);
                    }
                }
                let is_hilly = dice.chance(0.3);
                if is_hilly { dice.range(1.0, 3.0) } else { 1.0 }
            }
        };
        let mut under = [0.0; 2];
        for [height, kx, ky, phase] in &mut self.waves {
            *height *= scale;
            under[0] += *height * *kx * phase.cos();
            under[1] += *height * *ky * phase.cos();
        }
        if scale > 1.0 {
            // The vehicle and its sensor tilt with the slope below them.
            for (slope, under) in self.slope.iter_mut().zip(under) {
                *slope -= 0.85 * under;
            }
        }
    }

    /// Sensor frame to road frame.
    pub(crate) fn road(&self, x: f32, y: f32) -> (f32, f32) {
        let (sin, cos) = self.yaw_rad.sin_cos();
        (x * cos + y * sin, y * cos - x * sin + self.lane_m)
    }

    /// Road frame to sensor frame.
    pub(crate) fn sensor(&self, along: f32, across: f32) -> (f32, f32) {
        let (sin, cos) = self.yaw_rad.sin_cos();
        let w = across - self.lane_m;
        (along * cos - w * sin, along * sin + w * cos)
    }

    /// Height of the ground under (x, y) of the sensor frame, m.
    pub(crate) fn height(&self, x: f32, y: f32) -> f32 {
        self.relief(x, y) - self.relief(0.0, 0.0) - self.sensor_height_m
    }

    fn relief(&self, x: f32, y: f32) -> f32 {
        let (along, across) = self.road(x, y);
        let wave = |[a, kx, ky, phase]: [f32; 4]| a * (kx * x + ky * y + phase).sin();
        let waves: f32 = self.waves.into_iter().map(wave).sum();
        self.slope[0] * x + self.slope[1] * y + waves + self.section(along, across)
    }

    /// Height of the cross-section: crown, kerb, bank.
    fn section(&self, along: f32, across: f32) -> f32 {
        let out = across.abs();
        let crosses = |[at, half]: [f32; 2]| (along - at).abs() < half;
        if out <= self.half_width_m || self.crossing.is_some_and(crosses) {
            let t = (out / self.half_width_m).min(1.0);
            return -self.crown_m * t * t;
        }
        let bank = self.bank[usize::from(across <= 0.0)];
        let from_crossing = |[at, half]: [f32; 2]| ((along - at).abs() - half) / self.ramp_m;
        let share = self.crossing.map_or(1.0, from_crossing).min(1.0);
        self.kerb_m - self.crown_m + share * bank * (out - self.edge_m).clamp(0.0, 30.0)
    }

    /// Slope of the ground at (x, y) over the size of a vehicle: dz/dx, dz/dy.
    pub(crate) fn gradient(&self, x: f32, y: f32) -> (f32, f32) {
        let d = 1.5;
        let along_x = (self.height(x + d, y) - self.height(x - d, y)) / (2.0 * d);
        let along_y = (self.height(x, y + d) - self.height(x, y - d)) / (2.0 * d);
        let limit = self.steepest;
        (along_x.clamp(-limit, limit), along_y.clamp(-limit, limit))
    }

    /// Triangles on a grid along the road: 0.6 m near the sensor, coarser with distance; kerbs are steps between two lines.
    pub(crate) fn mesh(&self, family: Family, dice: &mut Dice) -> Mesh {
        let behind = match family {
            Family::SimKitti => -4.0,
            Family::SimUdi | Family::SimAny => -85.0,
        };
        let mut along = lines(behind, 90.0, 0.0);
        if let Some([at, half]) = self.crossing {
            along.extend([at - half, at - half + 0.02, at + half - 0.02, at + half]);
        }
        let mut across = lines(-80.0 + self.lane_m, 80.0 + self.lane_m, self.lane_m);
        for side in [-1.0, 1.0] {
            let edges = [self.half_width_m, self.half_width_m + 0.02, self.edge_m];
            across.extend(edges.map(|edge| side * edge));
        }
        along.sort_by(f32::total_cmp);
        across.sort_by(f32::total_cmp);
        let road = solid(dice.range(0.12, 0.24));
        let verge = solid(dice.range(0.2, 0.4));
        let mut mesh = Mesh::default();
        for &u in &along {
            for &w in &across {
                let rough = self.rough_m[usize::from(w.abs() > self.edge_m)];
                let (x, y) = self.sensor(u, w);
                mesh.vertex(v(x, y, self.height(x, y) + dice.spread(rough)));
            }
        }
        let columns = across.len();
        for i in 0..along.len() - 1 {
            for j in 0..columns - 1 {
                let is_road = across[j].abs().max(across[j + 1].abs()) <= self.edge_m;
                let surface = if is_road { road } else { verge };
                let at = |a: usize, b: usize| (a * columns + b) as u32;
                mesh.face([at(i, j), at(i + 1, j), at(i + 1, j + 1)], surface);
                mesh.face([at(i, j), at(i + 1, j + 1), at(i, j + 1)], surface);
            }
        }
        mesh
    }

    /// Plane through the ground below `at`, as (normal, offset) with normal . p + offset = 0; p is relative to `at`.
    pub(crate) fn plane(&self, at: V3) -> (V3, f32) {
        let (gx, gy) = self.gradient(at.x, at.y);
        let normal = v(-gx, -gy, 1.0).normalize();
        (normal, -normal.z * (self.height(at.x, at.y) - at.z))
    }
}

/// Grid lines from low to high, dense near the middle.
fn lines(low: f32, high: f32, middle: f32) -> Vec<f32> {
    let mut result = vec![middle];
    for (limit, sign) in [(high - middle, 1.0), (middle - low, -1.0)] {
        let mut distance = 0.0;
        while distance < limit {
            distance += (0.085 * distance).max(0.6);
            result.push(middle + sign * distance.min(limit));
        }
    }
    result
}
