//! What a picture from above shows: its boxes, its part of the world, its colours.

use super::canvas::Color;
use super::color::label_color;
use mluc_geometry::Box3;

/// What a box is.
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
    /// Where it is.
    pub box_in_sensor: Box3,
    /// How it is drawn.
    pub kind: BoxKind,
    /// Class, for the colour and the legend.
    pub label: String,
    /// Short text beside the box; empty for none.
    pub caption: String,
}

/// How points are coloured.
#[derive(Clone, Debug)]
pub enum PointColor {
    /// By z from 2.2 m below the sensor to 1.2 m above it.
    Height,
    /// One colour a point, in their order; points beyond the list are grey.
    Each(Vec<Color>),
}

/// What part of the world is shown, and how.
#[derive(Clone, Debug)]
pub struct View {
    /// Lowest and highest x shown, m.
    pub x_m: [f32; 2],
    /// Lowest and highest y shown, m.
    pub y_m: [f32; 2],
    /// Pixels a metre.
    pub px_per_m: f32,
    /// Colours of the points.
    pub color: PointColor,
    /// First line in the upper left corner.
    pub title: String,
}

impl View {
    /// Full circle out to 51.2 m, 10 px a metre.
    pub fn around() -> View {
        View {
            x_m: [-51.2, 51.2],
            y_m: [-51.2, 51.2],
            px_per_m: 10.0,
            color: PointColor::Height,
            title: String::new(),
        }
    }

    /// The half before the sensor: 70.4 m ahead, 40 m to each side.
    pub fn ahead() -> View {
        View {
            x_m: [-2.0, 70.4],
            y_m: [-40.0, 40.0],
            ..View::around()
        }
    }

    pub(super) fn at(&self, x_m: f32, y_m: f32) -> [f32; 2] {
        [
            (self.y_m[1] - y_m) * self.px_per_m,
            (self.x_m[1] - x_m) * self.px_per_m,
        ]
    }
}

/// Colour of a box: unknown objects share one.
pub(super) fn color_of(drawn: &DrawnBox) -> Color {
    let is_unknown = drawn.kind == BoxKind::Unknown;
    label_color(if is_unknown { "unknown" } else { &drawn.label })
}
