//! One turn of the sensor: every ray is cast, passes windows and foliage, returns or is lost, and is measured.

use super::scene::{Scene, Searchable};
use super::sensor::{Hit, Sensor, Shot, Stream, drop_probability};
use super::{background::Thing, mesh::Kind, random::splitmix64, random::unit};
use parry3d::query::{Ray, RayCast};

/// Maximum number of surfaces that one ray may pass; then it is lost.
const PASSES_MAX: usize = 8;
/// Range step of a depth edge between neighbouring rays, m.
const EDGE_M: [f32; 2] = [0.3, 4.0];
/// Heaviest rain: share of rays that a drop returns; mean distance of the drop, m; distance over which the other rays decay by a factor e, m.
const DROPS: f32 = 0.03;
const DROPS_M: f32 = 4.0;
const CLEAR_M: f32 = 120.0;

/// Points with their instances; and, for every ray, the instance that it ended on before noise and drop (row per beam, then column).
pub(crate) struct Sweep {
    pub(crate) points: Vec<[f32; 4]>,
    pub(crate) instances: Vec<u16>,
    pub(crate) times_s: Vec<f32>,
    pub(crate) ended_on: Vec<Option<u16>>,
}

/// Casts all rays of a turn.
pub(crate) fn sweep(sensor: &Sensor, scene: &Scene) -> Result<Sweep, String> {
    let world = scene.searchable(0..scene.mesh.triangles.len())?;
    let columns = sensor.column_count;
    let hit = |i: usize| {
        let shot = (i / columns, i % columns);
        in_rain(sensor, scene.rain, shot, trace(&world, sensor, shot))
    };
    let hits: Vec<_> = (0..sensor.beam_count() * columns).map(hit).collect();
    let mut sweep = Sweep {
        points: Vec::with_capacity(hits.len()),
        instances: Vec::with_capacity(hits.len()),
        times_s: Vec::with_capacity(hits.len()),
        ended_on: hits.iter().map(|hit| hit.map(|h| h.instance)).collect(),
    };
    for (i, hit) in hits.iter().enumerate() {
        let shot @ (beam, column) = (i / columns, i % columns);
        let Some(hit) = hit else { continue };
        let neighbour = hits[beam * columns + (column + 1) % columns];
        let first = returned(sensor, *hit, neighbour, shot).map(|point| (point, hit.instance));
        let is_dual = unit(sensor.bits(Stream::Second, shot)) < sensor.second_returns;
        let behind = neighbour.filter(|n| is_dual && n.range_m - hit.range_m > EDGE_M[0]);
        let second = behind.and_then(|b| Some((returned(sensor, b, None, shot)?, b.instance)));
        for (point, instance) in first.into_iter().chain(second) {
            sweep.points.push(point);
            sweep.instances.push(instance);
            sweep.times_s.push(sensor.time_s(column));
        }
    }
    Ok(sweep)
}

/// Follows one ray to the surface that stops it. The random draws at each surface depend only on the ray and the number of passes, so that the same
/// rays hit an object alone and in the scene.
pub(crate) fn trace(world: &Searchable, sensor: &Sensor, shot: Shot) -> Option<Hit> {
    if sensor.is_blind(shot) {
        return None;
    }
    let (start, direction) = sensor.ray(shot);
    let mut bits = sensor.bits(Stream::Pass, shot);
    let mut from = 0.0;
    for _ in 0..PASSES_MAX {
        let ray = Ray::new(start + direction * from, direction);
        let (mesh, left_m) = (&world.mesh, sensor.range_m[1] - from);
        let hit = mesh.cast_local_ray_and_get_normal(&ray, left_m, false)?;
        let face = hit.subshape as usize;
        let surface = *world.surfaces.get(face)?;
        let range_m = from + hit.time_of_impact;
        bits = splitmix64(bits);
        let stops = match surface.kind {
            Kind::Solid => true,
            Kind::Porous(passes) => unit(bits) >= passes,
            Kind::Glass if unit(bits) < sensor.glass[0] => false,
            Kind::Glass if unit(bits) < sensor.glass[0] + sensor.glass[1] => return None,
            Kind::Glass => true,
        };
        if stops {
            let cos_incidence = hit.normal.dot(-direction).abs();
            return (range_m > sensor.range_m[0]).then_some(Hit {
                range_m,
                cos_incidence,
                rho: surface.rho,
                instance: world.instances[face],
            });
        }
        from = range_m + 1e-3;
    }
    None
}

/// In rain a drop near the sensor returns some rays, and more of the others are lost at larger distance.
pub(crate) fn in_rain(sensor: &Sensor, rain: f32, shot: Shot, hit: Option<Hit>) -> Option<Hit> {
    if rain <= 0.0 || sensor.is_blind(shot) {
        return hit;
    }
    let bits = sensor.bits(Stream::Rain, shot);
    let lot = unit(bits);
    let drop_m = sensor.range_m[0] - DROPS_M * (1.0 - unit(splitmix64(bits))).ln();
    if lot < DROPS * rain && hit.is_none_or(|hit| drop_m < hit.range_m) {
        return Some(Hit {
            range_m: drop_m,
            cos_incidence: 1.0,
            rho: 0.3,
            instance: Thing::Rain.instance(),
        });
    }
    hit.filter(|hit| 1.0 - lot < (-rain * hit.range_m / CLEAR_M).exp())
}

/// The returned point, or `None` when it is lost.
fn returned(sensor: &Sensor, hit: Hit, neighbour: Option<Hit>, shot: Shot) -> Option<[f32; 4]> {
    let lost = drop_probability(sensor, hit.range_m, hit.rho, hit.cos_incidence);
    if unit(sensor.bits(Stream::Drop, shot)) < lost {
        return None;
    }
    let true_m = mixed(sensor, hit.range_m, neighbour, shot);
    let range_m = sensor.measured(true_m, shot);
    if !(sensor.range_m[0]..sensor.range_m[1]).contains(&range_m) {
        return None;
    }
    let (start, direction) = sensor.ray_in_sensor(shot);
    let p = start + direction * range_m;
    Some([p.x, p.y, p.z, sensor.intensity(&hit, shot)])
}

/// A pulse that straddles a depth edge is sometimes reported at the nearer surface or between the two.
fn mixed(sensor: &Sensor, range_m: f32, neighbour: Option<Hit>, shot: Shot) -> f32 {
    let other_m = neighbour.map_or(range_m, |n| n.range_m);
    let step = range_m - other_m;
    let bits = sensor.bits(Stream::Mixed, shot);
    if !(EDGE_M[0]..EDGE_M[1]).contains(&step) || unit(bits) >= sensor.noise.mixed {
        return range_m;
    }
    let share = unit(splitmix64(bits));
    other_m + step * (share - 0.5).max(0.0) * 2.0
}
