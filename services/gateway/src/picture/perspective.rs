//! A scan from behind and above the sensor, where boxes have heights.

use super::bird_eye::{RAMP_M, bounds_px, color_of_height, draw_captions, splat};
use super::view::{BoxKind, DrawnBox, NIGHT, color_of};
use super::{canvas::Canvas, legend::draw_legend};
use mluc_geometry::Box3;

/// Position of the camera in the sensor frame, m.
const EYE_M: [f64; 3] = [-16.0, 0.0, 9.0];
/// Downward pitch of the camera, rad.
const DOWN_RAD: f64 = 0.25;
/// Focal length, in widths of the picture.
const FOCAL: f64 = 0.65;
/// Height of the picture, in widths of the picture.
const HEIGHT: f64 = 0.5625;
/// Range of depth that is drawn, m. Points and boxes outside it are left out.
const DEPTH_M: std::ops::Range<f64> = 1.0..500.0;

/// Draws a scan from behind; points and boxes that are not finite are left out.
pub fn perspective(scan: &[[f32; 4]], boxes: &[DrawnBox], title: &str, width_px: usize) -> Canvas {
    let height_px = (width_px as f64 * HEIGHT) as usize;
    let mut canvas = Canvas::new(width_px, height_px, NIGHT);
    let project = |point_m: [f64; 3]| project(point_m, width_px as f64);
    let dot = |p: &[f32; 4]| Some((project([0, 1, 2].map(|i| f64::from(p[i])))?, p[2]));
    let mut dots: Vec<_> = scan.iter().filter_map(dot).collect();
    // Near points are drawn last and cover far ones.
    dots.sort_by(|((_, a), _), ((_, b), _)| b.total_cmp(a));
    for ((at, _), z_m) in dots {
        splat(&mut canvas, at, color_of_height(z_m));
    }
    let mut bounds = vec![];
    for drawn in boxes {
        let corners = corners_m(&drawn.box_in_sensor).map(project);
        if let Some(corners) = corners.into_iter().collect::<Option<Vec<_>>>() {
            let corners: Vec<[f32; 2]> = corners.into_iter().map(|(at, _)| at).collect();
            draw_box(&mut canvas, drawn, &corners);
            bounds.push((drawn, bounds_px(&corners)));
        }
    }
    draw_captions(&mut canvas, bounds);
    draw_legend(&mut canvas, boxes, title, RAMP_M);
    canvas
}

/// Pixel, and depth in m; `None`: outside the range of depth or far outside the picture.
fn project([x, y, z]: [f64; 3], width_px: f64) -> Option<([f32; 2], f64)> {
    let (sin, cos) = DOWN_RAD.sin_cos();
    let [ahead, left, up] = [x - EYE_M[0], y - EYE_M[1], z - EYE_M[2]];
    let (depth, up) = (ahead * cos - up * sin, ahead * sin + up * cos);
    let at = |offset: f64, middle: f64| (width_px * (middle - FOCAL * offset / depth)) as f32;
    let at = [at(left, 0.5), at(up, HEIGHT / 2.0)];
    (DEPTH_M.contains(&depth) && at.iter().all(|v| v.abs() < 1e5)).then_some((at, depth))
}

/// Corners of a box, m: the footprint at the bottom, then at the top.
fn corners_m(shape: &Box3) -> [[f64; 3]; 8] {
    let footprint_m = shape.footprint_m();
    std::array::from_fn(|i| {
        let [x, y] = footprint_m[i % 4];
        let half_m = shape.size_m[2] / 2.0;
        let up_m = if i < 4 { -half_m } else { half_m };
        [x, y, shape.center_m[2] + up_m]
    })
}

/// Draws the twelve edges and the filled front.
fn draw_box(canvas: &mut Canvas, drawn: &DrawnBox, corners: &[[f32; 2]]) {
    let color = color_of(drawn);
    let is_unknown = drawn.kind == BoxKind::Unknown;
    let width = if is_unknown { 2.5 } else { 1.5 };
    canvas.polygon(&[0, 3, 7, 4].map(|i| corners[i]), color, 0.3);
    for i in 0..4 {
        for (a, b) in [(i, (i + 1) % 4), (i + 4, (i + 1) % 4 + 4), (i, i + 4)] {
            canvas.line(corners[a], corners[b], width, color, 0.95);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn higher_is_above_left_is_left_and_what_lies_behind_the_eye_is_left_out() {
        let at = |point_m| project(point_m, 1000.0).map(|(at, _)| at);
        let middle = at([20.0, 0.0, 0.0]).expect("ahead");
        assert_eq!(middle[0], 500.0);
        assert!(at([20.0, 0.0, 2.0]).expect("ahead")[1] < middle[1]);
        assert!(at([20.0, 3.0, 0.0]).expect("ahead")[0] < middle[0]);
        assert_eq!([at([-40.0, 0.0, 0.0]), at([f64::NAN, 0.0, 0.0])], [None; 2]);
    }

    #[test]
    fn a_box_is_drawn_where_it_is_and_what_is_not_finite_is_left_out() {
        let drawn = |x_m: f64| DrawnBox {
            box_in_sensor: Box3::new([x_m, 0.0, 0.0, 4.0, 2.0, 1.5, 0.0]),
            kind: BoxKind::Unknown,
            label: "unknown".into(),
            caption: String::new(),
        };
        let picture = |boxes: &[DrawnBox]| perspective(&[[f32::NAN; 4]], boxes, "", 640);
        let [none, one, broken] =
            [vec![], vec![drawn(10.0)], vec![drawn(f64::NAN)]].map(|boxes| picture(&boxes));
        let changes = |canvas: &Canvas| {
            let places = (0..360).flat_map(|y| (250..390).map(move |x| (x, y)));
            let is_changed = |(x, y): &(_, _)| canvas.pixel(*x, *y) != none.pixel(*x, *y);
            places.filter(is_changed).count()
        };
        assert!(changes(&one) > 200);
        assert_eq!(changes(&broken), 0);
    }
}
