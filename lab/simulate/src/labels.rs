//! Labels of a scanned frame: visibility, points in each box, the rectangle in the image.

use super::mesh::V3;
use super::scan::{Sweep, trace};
use super::scene::{Scene, Solid};
use super::sensor::{BEAMS, Sensor};
use super::{Family, SimulateError, SimulatedFrame, SimulatedObject};
use mluc_geometry::{Calibration, ImageSize};

/// An object that got no label: no ray ended on it.
const UNLABELLED: u16 = 0x7FFF;
const IMAGE_PX: [f64; 2] = [1242.0, 375.0];

/// Calibration of a family: `sim-kitti` looks through a camera like KITTI's left colour camera, `sim-udi` has none.
pub fn calibration(family: Family) -> Result<Calibration, SimulateError> {
    match family {
        Family::SimUdi => Ok(Calibration::without_camera()),
        Family::SimKitti => {
            let p2 = [
                [721.54, 0.0, 609.56, 45.0],
                [0.0, 721.54, 172.85, 0.0],
                [0.0, 0.0, 1.0, 0.0],
            ];
            let identity = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
            Ok(Calibration::new(p2, identity, camera_from_sensor())?)
        }
    }
}

/// Size of the image that `sim-kitti`'s labels refer to.
pub fn image_size() -> ImageSize {
    ImageSize::KITTI
}

/// The camera hangs 8 cm below and 27 cm before the sensor and is turned against it by a fraction of a degree about each axis.
fn camera_from_sensor() -> [[f64; 4]; 3] {
    let [roll, pitch, yaw] = [0.4f64, -0.7, 0.5].map(f64::to_radians);
    let (sr, cr, sp, cp, sy, cy) = (
        roll.sin(),
        roll.cos(),
        pitch.sin(),
        pitch.cos(),
        yaw.sin(),
        yaw.cos(),
    );
    // Rows: the tilted sensor axes; then camera x = -y, y = -z, z = x.
    let tilted = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ];
    let row = |source: [f64; 3], sign: f64, shift: f64| {
        [sign * source[0], sign * source[1], sign * source[2], shift]
    };
    [
        row(tilted[1], -1.0, -0.004),
        row(tilted[2], -1.0, -0.076),
        row(tilted[0], 1.0, -0.272),
    ]
}

/// Labels every object that holds a point and that a ray ended on; renumbers the instances to match.
pub(crate) fn label(
    family: Family,
    sensor: &Sensor,
    scene: &Scene,
    solids: &[Solid],
    sweep: Sweep,
) -> Result<SimulatedFrame, String> {
    let calibration = calibration(family).map_err(|e| e.to_string())?;
    let mut renumbered = vec![UNLABELLED; solids.len() + 1];
    renumbered[0] = 0;
    let mut objects = Vec::new();
    for (index, solid) in solids.iter().enumerate() {
        let instance = (index + 1) as u16;
        let own = sweep.instances.iter().filter(|i| **i == instance).count();
        let points = points_inside(solid, &sweep.points);
        if own == 0 || points == 0 {
            continue;
        }
        let (image_box_px, truncated) =
            image_box(&calibration, &scene.mesh.vertices[solid.vertices.clone()]);
        objects.push(SimulatedObject {
            class: solid.class,
            box_in_sensor: solid.box_in_sensor,
            visibility: visibility(sensor, scene, solid, instance, &sweep)?,
            points,
            image_box_px,
            truncated,
        });
        renumbered[index + 1] = objects.len() as u16;
    }
    let instances = sweep
        .instances
        .iter()
        .map(|i| renumbered.get(usize::from(*i)).copied().unwrap_or(*i))
        .collect();
    Ok(SimulatedFrame {
        points: sweep.points,
        objects,
        instances,
        plane: [0.0; 4],
    })
}

fn points_inside(solid: &Solid, points: &[[f32; 4]]) -> u32 {
    let b = &solid.box_in_sensor;
    let reach = b.size_m[0].hypot(b.size_m[1]) / 2.0;
    let near = |p: &&[f32; 4]| {
        (f64::from(p[0]) - b.center_m[0]).abs() <= reach
            && (f64::from(p[1]) - b.center_m[1]).abs() <= reach
    };
    points
        .iter()
        .filter(near)
        .filter(|p| b.contains([p[0], p[1], p[2]].map(f64::from)))
        .count() as u32
}

/// Rays that ended on the object over rays that would if it stood alone.
fn visibility(
    sensor: &Sensor,
    scene: &Scene,
    solid: &Solid,
    instance: u16,
    sweep: &Sweep,
) -> Result<f32, String> {
    let alone = scene.searchable(solid.faces.clone())?;
    let columns = sensor.column_count();
    let window = Window::around(&scene.mesh.vertices[solid.vertices.clone()]);
    let (mut seen, mut possible) = (0u32, 0u32);
    for beam in 0..BEAMS {
        if !window.beam(sensor.ray(beam, 0).1) {
            continue;
        }
        for column in 0..columns {
            if !window.column(sensor.column_direction(column)) {
                continue;
            }
            seen += u32::from(sweep.ended_on[beam * columns + column] == Some(instance));
            possible += u32::from(trace(&alone, sensor, beam, column).is_some());
        }
    }
    Ok(if possible == 0 {
        0.0
    } else {
        (seen as f32 / possible as f32).min(1.0)
    })
}

/// The part of the sphere of directions that an object can be in.
struct Window {
    middle: [f32; 2],
    cos_half: f32,
    slope: [f32; 2],
}

impl Window {
    fn around(vertices: &[V3]) -> Window {
        let sum = vertices
            .iter()
            .fold([0.0, 0.0], |s, p| [s[0] + p.x, s[1] + p.y]);
        let length = sum[0].hypot(sum[1]).max(1e-6);
        let middle = [sum[0] / length, sum[1] / length];
        let mut window = Window {
            middle,
            cos_half: 1.0,
            slope: [f32::MAX, f32::MIN],
        };
        for p in vertices {
            let flat = p.x.hypot(p.y).max(1e-3);
            window.cos_half = window
                .cos_half
                .min((p.x * middle[0] + p.y * middle[1]) / flat);
            let slope = p.z / flat;
            window.slope = [window.slope[0].min(slope), window.slope[1].max(slope)];
        }
        window
    }

    fn beam(&self, direction: V3) -> bool {
        // The lower block starts 4 cm lower, which matters near by: a margin of 2 degrees covers it.
        let slope = direction.z / direction.x.hypot(direction.y);
        slope > self.slope[0] - 0.035 && slope < self.slope[1] + 0.035
    }

    fn column(&self, direction: [f32; 2]) -> bool {
        // A column's beams are up to one column apart (3 mrad).
        let cos = direction[0] * self.middle[0] + direction[1] * self.middle[1];
        cos > self.cos_half
            || cos.clamp(-1.0, 1.0).acos() < self.cos_half.clamp(-1.0, 1.0).acos() + 0.01
    }
}

/// Rectangle around the projected vertices, clipped to the image, and the share of it that was cut off. Without a camera the rectangle that the evaluation
/// of camera-less data expects; outside of the image nothing, fully truncated.
fn image_box(calibration: &Calibration, vertices: &[V3]) -> ([f64; 4], f64) {
    if !calibration.has_camera() {
        return ([0.0, 0.0, 100.0, 100.0], 0.0);
    }
    let mut rect = [f64::MAX, f64::MAX, f64::MIN, f64::MIN];
    for p in vertices {
        if let Some([u, w]) = calibration.project_point_to_image([p.x, p.y, p.z].map(f64::from)) {
            rect = [
                rect[0].min(u),
                rect[1].min(w),
                rect[2].max(u),
                rect[3].max(w),
            ];
        }
    }
    let area = |r: [f64; 4]| (r[2] - r[0]).max(0.0) * (r[3] - r[1]).max(0.0);
    let clipped = [
        rect[0].max(0.0),
        rect[1].max(0.0),
        rect[2].min(IMAGE_PX[0] - 1.0),
        rect[3].min(IMAGE_PX[1] - 1.0),
    ];
    if rect[2] < rect[0] || clipped[2] <= clipped[0] || clipped[3] <= clipped[1] {
        return ([0.0; 4], 1.0);
    }
    (clipped, (1.0 - area(clipped) / area(rect)).clamp(0.0, 1.0))
}
