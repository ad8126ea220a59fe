//! A scan from above: points by colour, boxes by kind, range rings in metres. Forward (+x) is up, left (+y) is left.

use super::view::{BoxKind, DrawnBox, NIGHT, RING, View, color_of, ramp};
use super::{canvas::Canvas, canvas::Color, captions::Captions, legend::draw_legend};

/// Heights at the ends of the colour ramp, m above the sensor.
pub(super) const RAMP_M: [f32; 2] = [-2.2, 1.2];

/// Draws a scan from above. Points that are not finite or lie outside the view are left out.
pub fn bird_eye(points: &[[f32; 4]], boxes: &[DrawnBox], view: &View) -> Canvas {
    let width = (view.y_m[1] - view.y_m[0]) * view.px_per_m;
    let height = (view.x_m[1] - view.x_m[0]) * view.px_per_m;
    let mut canvas = Canvas::new(width.round() as usize, height.round() as usize, NIGHT);
    draw_rings(&mut canvas, view);
    draw_points(&mut canvas, points, view);
    for drawn in boxes {
        draw_box(&mut canvas, drawn, view);
    }
    let bounds = |b| corners_px(b, view).map(|corners| (b, bounds_px(&corners)));
    draw_captions(&mut canvas, boxes.iter().filter_map(bounds).collect());
    // The sensor and its forward direction.
    let (center, tip) = (view.at(0.0, 0.0), view.at(1.8, 0.0));
    canvas.line(center, tip, 2.0, [240, 240, 240], 0.9);
    canvas.ring(center, 4.0, 2.0, [240, 240, 240], 0.9);
    draw_legend(&mut canvas, boxes, &view.title, RAMP_M);
    canvas
}

fn draw_rings(canvas: &mut Canvas, view: &View) {
    let center = view.at(0.0, 0.0);
    let furthest = view.x_m.iter().chain(&view.y_m).fold(0.0f32, |m, v| m.max(v.abs()));
    let tens = (1..).map(|ten| ten as f32 * 10.0);
    for radius in tens.take_while(|r| *r <= furthest) {
        canvas.ring(center, radius * view.px_per_m, 1.2, RING, 0.8);
        let at = view.at(radius, 0.0).map(|v| v as i64 + 4);
        let color = RING.map(|c| c.saturating_add(50));
        canvas.text(at, &format!("{radius:.0} m"), 1, color);
    }
}

/// Draws low points first, so that high points are on top.
fn draw_points(canvas: &mut Canvas, points: &[[f32; 4]], view: &View) {
    let is_finite = |i: &usize| points[*i][..3].iter().all(|v| v.is_finite());
    let mut order: Vec<usize> = (0..points.len()).filter(is_finite).collect();
    order.sort_by(|a, b| points[*a][2].total_cmp(&points[*b][2]).then(a.cmp(b)));
    for index in order {
        let [x, y, z, _] = points[index];
        if !(view.x_m[0]..view.x_m[1]).contains(&x) || !(view.y_m[0]..view.y_m[1]).contains(&y) {
            continue;
        }
        splat(canvas, view.at(x, y), color_of_height(z));
    }
}

pub(super) fn color_of_height(z_m: f32) -> Color {
    ramp((z_m - RAMP_M[0]) / (RAMP_M[1] - RAMP_M[0]))
}

/// A soft dot of about one and a half pixels, spread over four.
pub(super) fn splat(canvas: &mut Canvas, at: [f32; 2], color: Color) {
    let (x, y) = (at[0] - 0.5, at[1] - 0.5);
    let (fx, fy) = (x - x.floor(), y - y.floor());
    for (dx, wx) in [(0, 1.0 - fx), (1, fx)] {
        for (dy, wy) in [(0, 1.0 - fy), (1, fy)] {
            let [x, y] = [x.floor() as i64 + dx, y.floor() as i64 + dy];
            canvas.blend(x, y, color, 0.25 + 0.75 * wx * wy);
        }
    }
}

/// Corners of the footprint in pixels; `None`: a corner is not finite or lies far outside the picture.
fn corners_px(drawn: &DrawnBox, view: &View) -> Option<[[f32; 2]; 4]> {
    let footprint_m = drawn.box_in_sensor.footprint_m();
    let corners = footprint_m.map(|[x, y]| view.at(x as f32, y as f32));
    let is_sane = |v: &f32| v.is_finite() && v.abs() <= 1e5;
    corners.iter().flatten().all(is_sane).then_some(corners)
}

/// Draws the footprint with a bar at the front.
fn draw_box(canvas: &mut Canvas, drawn: &DrawnBox, view: &View) {
    let Some(corners) = corners_px(drawn, view) else {
        return;
    };
    let color = color_of(drawn);
    let (width, fill) = match drawn.kind {
        BoxKind::Known => (2.0, 0.18),
        BoxKind::Unknown => (3.0, 0.28),
        BoxKind::Truth => (1.4, 0.10),
    };
    canvas.polygon(&corners, color, fill);
    for i in 0..4 {
        canvas.line(corners[i], corners[(i + 1) % 4], width, color, 0.95);
    }
    // The front edge lies between the first and the last corner.
    let inwards = |a: [f32; 2], b: [f32; 2]| [0, 1].map(|i| a[i] + (b[i] - a[i]) * 0.18);
    let left = inwards(corners[0], corners[1]);
    let right = inwards(corners[3], corners[2]);
    canvas.line(left, right, width, color, 0.95);
}

/// Bounds of the corners: left, top, right, bottom, px.
pub(super) fn bounds_px(corners: &[[f32; 2]]) -> [i64; 4] {
    let of = |axis: usize, pick: fn(f32, f32) -> f32| {
        corners.iter().map(|corner| corner[axis]).reduce(pick).unwrap_or(0.0) as i64
    };
    let (low, high) = (f32::min, f32::max);
    [of(0, low), of(1, low), of(0, high), of(1, high)]
}

/// Draws the captions of boxes, given with their bounds. Unknown objects come first: they get the best places.
pub(super) fn draw_captions(canvas: &mut Canvas, mut order: Vec<(&DrawnBox, [i64; 4])>) {
    let taken = order.iter().map(|(_, bounds)| *bounds).collect();
    let mut captions = Captions::among(taken, canvas.size_px());
    order.sort_by_key(|(b, _)| b.kind != BoxKind::Unknown);
    for (drawn, bounds) in order.iter().filter(|(b, _)| !b.caption.is_empty()) {
        let size = Canvas::text_size_px(&drawn.caption, 1);
        let [x, y] = captions.place(*bounds, size);
        let end = [x + size[0] + 1, y + size[1] + 1];
        canvas.rectangle([x - 1, y - 1], end, NIGHT, 0.6);
        canvas.text([x, y], &drawn.caption, 1, color_of(drawn));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mluc_geometry::Box3;

    fn view() -> View {
        View { x_m: [-10.0, 10.0], y_m: [-10.0, 10.0], ..View::around() }
    }

    fn drawn(x_m: f64) -> DrawnBox {
        DrawnBox {
            box_in_sensor: Box3::new([x_m, 0.0, 0.0, 4.0, 2.0, 1.5, 0.0]),
            kind: BoxKind::Unknown,
            label: "unknown".into(),
            caption: "x".into(),
        }
    }

    #[test]
    fn a_point_ahead_is_above_the_middle_and_one_to_the_left_is_left_of_it() {
        let lone = |p: [f32; 4]| {
            let empty = bird_eye(&[], &[], &view());
            let canvas = bird_eye(&[p], &[], &view());
            let pixels = (0..200).flat_map(|y| (0..200).map(move |x| (x, y)));
            let is_changed = |(x, y): &(_, _)| canvas.pixel(*x, *y) != empty.pixel(*x, *y);
            let changed: Vec<_> = pixels.filter(is_changed).collect();
            assert!((1..=4).contains(&changed.len()), "{changed:?}");
            changed[0]
        };
        assert!(lone([5.05, 0.35, 0.0, 0.0]).1 < 60);
        assert!(lone([3.25, 5.05, 0.0, 0.0]).0 < 60);
    }

    #[test]
    fn boxes_have_the_colour_of_their_kind_and_what_is_not_finite_is_left_out() {
        let canvas = bird_eye(&[], &[drawn(5.0)], &view());
        // The right edge of the footprint is at y = -1 m.
        let [r, g, _] = canvas.pixel(110, 50).expect("inside");
        assert!(r > 200 && g < 110, "{r} {g}");
        let points = [[f32::NAN, 0.0, 0.0, 0.0], [f32::INFINITY, 1.0, 0.0, 0.0]];
        let canvas = bird_eye(&points, &[drawn(f64::NAN)], &view());
        assert_eq!(canvas.png(), bird_eye(&[], &[drawn(1e9)], &view()).png());
    }
}
