//! A labelled scan with what several methods found in it, ready to be drawn.

use super::perspective::Projection;
use mluc_evaluate::{ObjectKind, SensorDetection};
use mluc_gateway::picture::{Canvas, Color, label_color, ramp};
use mluc_geometry::Box3;
use mluc_ipc_types::Point;

const NIGHT: Color = [11, 15, 22];
const WHITE: Color = [245, 245, 245];
/// Heights at the ends of the colour ramp, m above the sensor.
const RAMP_M: [f32; 2] = [-2.2, 1.6];

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Panel {
    pub(crate) title: String,
    pub(crate) boxes: Vec<SensorDetection>,
}

/// A scan, its labels, and what was found.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct DrawnScene {
    /// What a reader should know: data set, frame, errors.
    pub(crate) caption: String,
    pub(crate) points: Vec<Point>,
    pub(crate) truth: Vec<SensorDetection>,
    /// One a method.
    pub(crate) panels: Vec<Panel>,
    /// Where to look: x, y, m.
    pub(crate) target_m: [f64; 2],
}

/// One panel: points by height, boxes as wires over `labelled` ones, which are dashed in white.
pub(super) fn draw(
    points: &[Point],
    boxes: &[SensorDetection],
    labelled: &[&SensorDetection],
    projection: &Projection,
) -> Canvas {
    let [width, height] = projection.size_px;
    let mut canvas = Canvas::new(width, height, NIGHT);
    draw_points(&mut canvas, points, projection);
    for label in labelled {
        for [a, b] in wires(&label.box_in_sensor, projection) {
            dashes(&mut canvas, a, b);
        }
    }
    for found in boxes {
        let (class, width) = match found.kind {
            ObjectKind::Unknown => ("unknown", 3.0),
            ObjectKind::Known => (found.class.as_str(), 1.8),
        };
        let color = label_color(class);
        fill(&mut canvas, &found.box_in_sensor, projection, color);
        for [a, b] in wires(&found.box_in_sensor, projection) {
            canvas.line(a, b, width, color, 0.95);
        }
    }
    canvas
}

/// Far points first, so that what is near is on top; from above, low points first.
fn draw_points(canvas: &mut Canvas, points: &[Point], projection: &Projection) {
    let seen = points.iter().filter_map(|p| {
        let (at, depth) = projection.project([p.x_m, p.y_m, p.z_m].map(f64::from))?;
        Some((depth, at, p.z_m))
    });
    let mut seen: Vec<(f32, [f32; 2], f32)> = seen.collect();
    seen.sort_by(|a, b| b.0.total_cmp(&a.0));
    for (depth, [x, y], z) in seen {
        let color = ramp((z - RAMP_M[0]) / (RAMP_M[1] - RAMP_M[0]));
        let (x, y) = (x.floor() as i64, y.floor() as i64);
        canvas.blend(x, y, color, 0.85);
        if projection.is_near(depth) {
            canvas.blend(x + 1, y, color, 0.7);
            canvas.blend(x, y + 1, color, 0.7);
        }
    }
}

/// The footprint so far above the middle of a box; `None` behind the eye.
fn corners(bounds: &Box3, above_m: f64, projection: &Projection) -> [Option<[f32; 2]>; 4] {
    let z = bounds.center_m[2] + above_m;
    let corner = |[x, y]: [f64; 2]| projection.project([x, y, z]).map(|(at, _)| at);
    bounds.footprint_m().map(corner)
}

/// The twelve edges that are in front of the eye.
fn wires(bounds: &Box3, projection: &Projection) -> Vec<[[f32; 2]; 2]> {
    let half = bounds.size_m[2] / 2.0;
    let corners = [-half, half].map(|above_m| corners(bounds, above_m, projection));
    let corners = corners.as_flattened();
    let edges = (0..4).flat_map(|i| [[i, (i + 1) % 4], [i + 4, (i + 1) % 4 + 4], [i, i + 4]]);
    let seen = edges.filter_map(|[a, b]| Some([corners[a]?, corners[b]?]));
    seen.collect()
}

fn fill(canvas: &mut Canvas, bounds: &Box3, projection: &Projection, color: Color) {
    let below = corners(bounds, -bounds.size_m[2] / 2.0, projection);
    if let [Some(a), Some(b), Some(c), Some(d)] = below {
        canvas.polygon(&[a, b, c, d], color, 0.25);
    }
}

fn dashes(canvas: &mut Canvas, a: [f32; 2], b: [f32; 2]) {
    let length = (b[0] - a[0]).hypot(b[1] - a[1]);
    // Wires that leave the picture far behind are not worth a thousand dashes.
    if !(1.0..4000.0).contains(&length) {
        return;
    }
    let mix = |t: f32| [0, 1].map(|i| a[i] + (b[i] - a[i]) * t / length);
    let mut from = 0.0;
    while from < length {
        canvas.line(mix(from), mix((from + 3.0).min(length)), 1.2, WHITE, 0.9);
        from += 6.0;
    }
}

/// Copies a picture into another.
pub(super) fn paste(onto: &mut Canvas, picture: &Canvas, left: usize, top: usize) {
    let [width, height] = picture.size_px();
    for y in 0..height {
        for x in 0..width {
            if let Some(color) = picture.pixel(x, y) {
                onto.blend((left + x) as i64, (top + y) as i64, color, 1.0);
            }
        }
    }
}
