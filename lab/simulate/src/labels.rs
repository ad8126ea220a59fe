//! Labels of a scanned frame: visibility, points in each box, the rectangle in the image.

use super::scan::{Sweep, in_rain, trace};
use super::scene::{Scene, Solid};
use super::{Family, SimulatedFrame, SimulatedObject, mesh::V3, sensor::Sensor};
use mluc_geometry::{Calibration, CalibrationError, ImageSize, pixel_bounds};
use std::f32::consts::PI;

/// Instance of an object without a label (no ray ended on it) and of the sensor's own vehicle.
pub(crate) const UNLABELLED: u16 = 0x7FFF;

/// Calibration of a family: `sim-kitti` has a camera like KITTI's left colour camera, the other families have none.
pub(crate) fn calibration(family: Family) -> Result<Calibration, CalibrationError> {
    if family != Family::SimKitti {
        return Ok(Calibration::without_camera());
    }
    let p2 = [[721.54, 0.0, 609.56, 45.0], [0.0, 721.54, 172.85, 0.0], [0.0, 0.0, 1.0, 0.0]];
    let identity = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    Calibration::new(p2, identity, camera_from_sensor())
}

/// The camera is 8 cm below and 27 cm ahead of the sensor and is rotated by a fraction of a degree about each axis.
fn camera_from_sensor() -> [[f64; 4]; 3] {
    let [roll, pitch, yaw] = [0.4f64, -0.7, 0.5].map(|angle| angle.to_radians().sin_cos());
    let ((sr, cr), (sp, cp), (sy, cy)) = (roll, pitch, yaw);
    // The tilted sensor axes; then camera x = -y, y = -z, z = x.
    let x = [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr];
    let y = [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr];
    let z = [-sp, cp * sr, cp * cr];
    [[-y[0], -y[1], -y[2], -0.004], [-z[0], -z[1], -z[2], -0.076], [x[0], x[1], x[2], -0.272]]
}

/// Labels every object that has a point in its box and that a ray ended on; renumbers the instances to match.
pub(crate) fn label(
    calibration: &Calibration,
    sensor: &Sensor,
    scene: &Scene,
    solids: &[Solid],
    sweep: Sweep,
) -> Result<SimulatedFrame, String> {
    let mut renumbered = vec![UNLABELLED; solids.len() + 1];
    renumbered[0] = 0;
    let mut objects = Vec::new();
    for (index, solid) in solids.iter().enumerate() {
        let instance = (index + 1) as u16;
        let points = sweep.instances.iter().zip(&sweep.times_s);
        let own = points.filter(|(i, _)| **i == instance);
        let mut times_s: Vec<f32> = own.map(|(_, time_s)| *time_s).collect();
        times_s.sort_by(f32::total_cmp);
        let Some(median_s) = times_s.get(times_s.len() / 2) else {
            continue;
        };
        let box_in_sensor = sensor.seen(solid.box_in_sensor, *median_s);
        let points = box_in_sensor.count_inside(&sweep.points) as u32;
        if points == 0 {
            continue;
        }
        let vertices = &scene.mesh.vertices[solid.vertices.clone()];
        let (image_box_px, truncated) = image_box(calibration, vertices);
        let end = solid.box_in_sensor;
        let at_end = sensor.motion.is_some_and(|motion| motion.labels_at_end);
        objects.push(SimulatedObject {
            class: solid.class,
            box_in_sensor: if at_end { end } else { box_in_sensor },
            visibility: visibility(sensor, scene, solid, instance, &sweep)?,
            points,
            image_box_px,
            truncated,
            number: index as u32,
        });
        renumbered[index + 1] = objects.len() as u16;
    }
    let label = |i: &u16| renumbered.get(usize::from(*i)).copied().unwrap_or(*i);
    let instances = sweep.instances.iter().map(label).collect();
    Ok(SimulatedFrame {
        points: sweep.points,
        times_s: sweep.times_s,
        objects,
        instances,
        plane: [0.0; 4],
    })
}

/// Number of rays that ended on the object, divided by the number that would end on it if it stood alone.
fn visibility(
    sensor: &Sensor,
    scene: &Scene,
    solid: &Solid,
    instance: u16,
    sweep: &Sweep,
) -> Result<f32, String> {
    let alone = scene.searchable(solid.faces.clone())?;
    let columns = sensor.column_count;
    let vertices = &scene.mesh.vertices[solid.vertices.clone()];
    let [x, y, _] = solid.box_in_sensor.center_m;
    let window = Window::around(vertices, sensor.stray_rad(x.hypot(y) as f32));
    let (mut seen, mut possible) = (0u32, 0u32);
    for beam in 0..sensor.beam_count() {
        if !window.beam(sensor.elevation_rad(beam).tan()) {
            continue;
        }
        for column in 0..columns {
            let shot = (beam, column);
            if !window.column(sensor.column_direction(shot)) {
                continue;
            }
            seen += u32::from(sweep.ended_on[beam * columns + column] == Some(instance));
            let hit = in_rain(sensor, scene.rain, shot, trace(&alone, sensor, shot));
            possible += u32::from(hit.is_some_and(|hit| hit.instance == instance));
        }
    }
    let share = (seen as f32 / possible as f32).min(1.0);
    Ok(if possible == 0 { 0.0 } else { share })
}

/// The range of directions of an object, with a margin.
struct Window {
    middle: [f32; 2],
    cos_half: f32,
    slope: [f32; 2],
}

impl Window {
    fn around(vertices: &[V3], margin_rad: f32) -> Window {
        let sum: V3 = vertices.iter().sum();
        let length = sum.x.hypot(sum.y).max(1e-6);
        let middle = [sum.x / length, sum.y / length];
        let (mut cos_half, mut low, mut high) = (1.0f32, f32::MAX, f32::MIN);
        for p in vertices {
            let flat = p.x.hypot(p.y).max(1e-3);
            cos_half = cos_half.min((p.x * middle[0] + p.y * middle[1]) / flat);
            (low, high) = (low.min(p.z / flat), high.max(p.z / flat));
        }
        let half_rad = cos_half.clamp(-1.0, 1.0).acos() + 0.01 + margin_rad;
        // The lower block of an HDL-64E is 4 cm lower, which matters at close range: a margin of 2 degrees covers it.
        let margin = 0.035 + 1.5 * margin_rad;
        Window { middle, cos_half: half_rad.min(PI).cos(), slope: [low - margin, high + margin] }
    }

    fn beam(&self, slope: f32) -> bool {
        slope > self.slope[0] && slope < self.slope[1]
    }

    fn column(&self, direction: [f32; 2]) -> bool {
        direction[0] * self.middle[0] + direction[1] * self.middle[1] > self.cos_half
    }
}

/// Rectangle around the projected vertices, clipped to the image, and the truncated share. Without a camera: the rectangle that the evaluation
/// of camera-less data expects. Outside the image: all 0, fully truncated.
fn image_box(calibration: &Calibration, vertices: &[V3]) -> ([f64; 4], f64) {
    if !calibration.has_camera() {
        return ([0.0, 0.0, 100.0, 100.0], 0.0);
    }
    let points = vertices.iter().map(|p| p.to_array().map(f64::from));
    let bounds = pixel_bounds(points.filter_map(|p| calibration.project_point_to_image(p)));
    let Some(clipped) = ImageSize::KITTI.clip(bounds) else {
        return ([0.0; 4], 1.0);
    };
    let area = |r: [f64; 4]| (r[2] - r[0]).max(0.0) * (r[3] - r[1]).max(0.0);
    let truncated = 1.0 - area(clipped) / area(bounds);
    (clipped, truncated.clamp(0.0, 1.0))
}
