//! The contents of a picture from above: its boxes, the area shown, its colours (dark background, a ramp for height, one colour per kind of box).

use super::canvas::Color;
use mluc_geometry::Box3;

/// Kind of a box.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BoxKind {
    /// A detection of a known class: solid, in the colour of its label.
    Known,
    /// A detection of an unknown object: thick red.
    Unknown,
    /// A label: thin, in the colour of its class.
    Truth,
}

/// A box to draw.
#[derive(Clone, Debug)]
pub struct DrawnBox {
    /// The box in the sensor's frame.
    pub box_in_sensor: Box3,
    /// How it is drawn.
    pub kind: BoxKind,
    /// Class, for the colour and the legend.
    pub label: String,
    /// Short text beside the box; empty for none.
    pub caption: String,
}

/// The area that a picture shows, its scale and its title.
#[derive(Clone, Debug)]
pub struct View {
    /// Lowest and highest x shown, m.
    pub x_m: [f32; 2],
    /// Lowest and highest y shown, m.
    pub y_m: [f32; 2],
    /// Pixels per metre.
    pub px_per_m: f32,
    /// Title: the first line in the upper left corner.
    pub title: String,
}

impl View {
    /// All around the sensor: 70.4 m ahead, 51.2 m in the other directions, 10 px per metre.
    pub fn around() -> View {
        View { x_m: [-51.2, 70.4], y_m: [-51.2, 51.2], px_per_m: 10.0, title: String::new() }
    }

    /// The half in front of the sensor: 70.4 m ahead, 40 m to each side.
    pub fn ahead() -> View {
        View { x_m: [-2.0, 70.4], y_m: [-40.0, 40.0], ..View::around() }
    }

    pub(super) fn at(&self, x_m: f32, y_m: f32) -> [f32; 2] {
        [self.y_m[1] - y_m, self.x_m[1] - x_m].map(|v_m| v_m * self.px_per_m)
    }
}

/// Colour of a box: unknown objects share one.
pub(super) fn color_of(drawn: &DrawnBox) -> Color {
    let is_unknown = drawn.kind == BoxKind::Unknown;
    label_color(if is_unknown { "unknown" } else { &drawn.label })
}

pub(super) const NIGHT: Color = [11, 15, 22];
pub(super) const RING: Color = [58, 70, 88];
pub(super) const CAPTION: Color = [168, 180, 196];

/// Knots of the height ramp: deep blue, teal, green, yellow, red.
const RAMP: [Color; 6] =
    [[44, 62, 140], [38, 130, 176], [52, 176, 138], [158, 204, 86], [244, 196, 72], [232, 98, 72]];

/// Colour at a position on the ramp, 0..1.
pub fn ramp(t: f32) -> Color {
    let t = if t.is_nan() { 0.0 } else { t.clamp(0.0, 1.0) } * (RAMP.len() - 1) as f32;
    let low = (t as usize).min(RAMP.len() - 2);
    let share = t - low as f32;
    std::array::from_fn(|i| {
        let (a, b) = (f32::from(RAMP[low][i]), f32::from(RAMP[low + 1][i]));
        (a + (b - a) * share).round() as u8
    })
}

/// Colour of a label. Common classes have their own colour, in upper or lower case; all others share one.
pub(crate) fn label_color(label: &str) -> Color {
    match label.to_ascii_lowercase().as_str() {
        "car" => [86, 180, 255],
        "pedestrian" => [120, 230, 120],
        "cyclist" => [255, 214, 90],
        "truck" => [190, 150, 255],
        "van" => [255, 150, 90],
        "golf_cart" | "golf cart" => [255, 120, 190],
        "forklift" => [255, 110, 110],
        "unknown" => [255, 84, 84],
        _ => [200, 200, 200],
    }
}
