//! A small scene for tests: boxes on flat ground, seen by 64 beams without noise.
#![allow(dead_code)]

use mluc_geometry::Box3;
use mluc_ipc_types::{Detection, DetectionKind, Disposition, FrameHeader, Object, Point};
use mluc_model::Beams;
use mluc_refiner::{Refiner, RefinerOutput, Sensor, Settings, Variant};

/// Length, width and height of a golf cart, m.
pub(crate) const CART: [f64; 3] = [2.6, 1.25, 1.85];
/// Height of the sensor above the ground, m.
pub(crate) const SENSOR_HEIGHT_M: f64 = 1.73;
const RANGE_MAX_M: f64 = 60.0;
const COLUMNS: usize = 1024;

/// Elevations of the beams, rad, from the top down.
pub(crate) fn elevations_rad() -> Vec<f64> {
    let elevation = |i| (2.0 - 0.42 * f64::from(i)).to_radians();
    (0..64).map(elevation).collect()
}

pub(crate) fn sensor() -> Sensor {
    Sensor {
        height_m: SENSOR_HEIGHT_M,
        beams: Some(Beams {
            elevation_rad: elevations_rad().iter().map(|&e| e as f32).collect(),
            azimuth_step_rad: (std::f64::consts::TAU / COLUMNS as f64) as f32,
        }),
        ..Sensor::plain(&["car", "pedestrian", "cyclist", "truck"])
    }
}

/// A box standing on the ground.
pub(crate) fn standing(x: f64, y: f64, [l, w, h]: [f64; 3], yaw_rad: f64) -> Box3 {
    Box3::new([x, y, h / 2.0 - SENSOR_HEIGHT_M, l, w, h, yaw_rad])
}

/// The points that 64 beams see of boxes on flat ground.
pub(crate) fn scan(boxes: &[Box3]) -> Vec<Point> {
    let mut points = Vec::new();
    for elevation in elevations_rad() {
        for column in 0..COLUMNS {
            let azimuth = (column as f64 + 0.5) * std::f64::consts::TAU / COLUMNS as f64;
            let flat = elevation.cos();
            let ray = [flat * azimuth.cos(), flat * azimuth.sin(), elevation.sin()];
            let ground = (ray[2] < 0.0).then(|| -SENSOR_HEIGHT_M / ray[2]);
            let hits = boxes.iter().filter_map(|b| hit(b, ray)).chain(ground);
            let range = hits.fold(f64::INFINITY, f64::min);
            if range < RANGE_MAX_M {
                points.push(point(ray.map(|r| r * range)));
            }
        }
    }
    points
}

pub(crate) fn point([x, y, z]: [f64; 3]) -> Point {
    bytemuck::cast([x, y, z, 0.3].map(|v| v as f32))
}

/// Where a ray from the sensor enters a box.
fn hit(b: &Box3, ray: [f64; 3]) -> Option<f64> {
    let from = b.local_m([0.0; 3]);
    let (sin, cos) = b.yaw_rad.sin_cos();
    let [x, y, z] = ray;
    let along = [x * cos + y * sin, y * cos - x * sin, z];
    let (mut enter, mut leave) = (0.0f64, f64::INFINITY);
    for axis in 0..3 {
        let at = |side: f64| (side * b.size_m[axis] / 2.0 - from[axis]) / along[axis];
        let [a, b] = [at(-1.0), at(1.0)];
        enter = enter.max(a.min(b));
        leave = leave.min(a.max(b));
    }
    (enter > 0.0 && enter <= leave).then_some(enter)
}

/// A candidate whose box is `shift` away from an object and has a wrong size.
pub(crate) fn candidate(object: &Box3, shift: [f64; 2], eds: f32) -> Detection {
    let [x, y, z] = object.center_m;
    Detection {
        center_m: [x + shift[0], y + shift[1], z].map(|v| v as f32),
        size_m: [1.76, 0.6, 1.73],
        yaw_rad: 0.7,
        kind: DetectionKind::Candidate as u32,
        objectness: 0.6,
        score: 0.3,
        eds,
        // The order equals the order of `eds`.
        eds_normalised: 1.0 + eds / 1000.0,
        ..Detection::default()
    }
}

/// A known object with its exact box.
pub(crate) fn known(object: &Box3, class_id: u32, score: f32) -> Detection {
    Detection {
        center_m: object.center_m.map(|v| v as f32),
        size_m: object.size_m.map(|v| v as f32),
        yaw_rad: object.yaw_rad as f32,
        kind: DetectionKind::Known as u32,
        class_id,
        score,
        objectness: score,
        eds: 6.0,
        ..Detection::default()
    }
}

pub(crate) fn refiner(variant: Variant) -> Refiner {
    Refiner::new(Settings::of(variant), &sensor()).expect("default settings")
}

pub(crate) fn refine(variant: Variant, points: &[Point], found: &[Detection]) -> RefinerOutput {
    let mut out = RefinerOutput::default();
    refiner(variant).refine(7, points, found, &mut out);
    assert_sound(points, found, &out);
    out
}

pub(crate) fn is(object: &Object, disposition: Disposition) -> bool {
    object.disposition == disposition as u32
}

pub(crate) fn box_of(object: &Object) -> Box3 {
    Box3::from_f32(object.center_m, object.size_m, object.yaw_rad)
}

/// Properties of every answer, whatever the input: the contract's own checks, one object per detection, second readings at the end, valid indices.
pub(crate) fn assert_sound(points: &[Point], detections: &[Detection], out: &RefinerOutput) {
    let header = FrameHeader::new(0, "test");
    Object::checked(&header, &out.objects, 4).expect("sound objects");
    Object::checked_points(&header, &out.object_points, points.len()).expect("sound indices");
    Object::checked_ranges(&out.objects, out.object_points.len()).expect("sound ranges");
    let count = detections.len().min(512);
    assert!((count..=512).contains(&out.objects.len()));
    assert!(out.objects[count..].iter().all(|o| o.kind == 0));
    let mut corners = out.objects.iter().flat_map(|o| o.footprint_m).flatten();
    assert!(corners.all(f32::is_finite));
}
