//! A drawing that becomes SVG or pixels: a list of simple shapes. Coordinates in px, x to the right, y down.

use mluc_gateway::picture::{Canvas, Color};
use std::fmt::Write as _;

/// What of a text stands at its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    /// Its left end.
    Start,
    /// Its middle.
    Middle,
    /// Its right end.
    End,
}

/// Something to draw.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// A line through points.
    Path {
        /// Corners.
        points: Vec<[f32; 2]>,
        /// Width, px.
        width_px: f32,
        /// Colour.
        color: Color,
        /// Whether it is broken into dashes.
        dashed: bool,
    },
    /// A disc.
    Dot {
        /// Centre.
        center: [f32; 2],
        /// Radius, px.
        radius_px: f32,
        /// Colour.
        color: Color,
    },
    /// A filled rectangle.
    Rectangle {
        /// Upper left.
        low: [f32; 2],
        /// Lower right.
        high: [f32; 2],
        /// Colour.
        color: Color,
    },
    /// A line of text; `at` is on its middle line.
    Text {
        /// Place.
        at: [f32; 2],
        /// The words.
        text: String,
        /// Height of a capital, px.
        height_px: f32,
        /// Colour.
        color: Color,
        /// What of it stands at the place.
        anchor: Anchor,
    },
}

/// A drawing.
#[derive(Clone, Debug, PartialEq)]
pub struct Drawing {
    /// Width and height, px.
    pub size_px: [f32; 2],
    /// Colour of the ground.
    pub background: Color,
    /// In order, the last on top.
    pub shapes: Vec<Shape>,
}

/// Length of a dash and of the gap after it, px.
const DASH_PX: [f32; 2] = [7.0, 5.0];

impl Drawing {
    /// Empty, on white.
    pub fn new(width_px: f32, height_px: f32) -> Drawing {
        Drawing {
            size_px: [width_px, height_px],
            background: [255, 255, 255],
            shapes: Vec::new(),
        }
    }

    /// Adds a line through points.
    pub fn path(&mut self, points: &[[f32; 2]], width_px: f32, color: Color) {
        self.shapes.push(Shape::Path {
            points: points.to_vec(),
            width_px,
            color,
            dashed: false,
        });
    }

    /// Adds a disc.
    pub fn dot(&mut self, center: [f32; 2], radius_px: f32, color: Color) {
        self.shapes.push(Shape::Dot {
            center,
            radius_px,
            color,
        });
    }

    /// Adds text.
    pub fn text(&mut self, at: [f32; 2], text: &str, height_px: f32, color: Color, anchor: Anchor) {
        self.shapes.push(Shape::Text {
            at,
            text: text.to_owned(),
            height_px,
            color,
            anchor,
        });
    }

    /// As SVG 1.1.
    pub fn to_svg(&self) -> String {
        let [w, h] = self.size_px;
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{w}\" height=\"{h}\" viewBox=\"0 0 {w} {h}\" \
             font-family=\"Helvetica, Arial, sans-serif\">\n<rect width=\"{w}\" height=\"{h}\" fill=\"{}\"/>\n",
            hex(self.background)
        );
        self.shapes
            .iter()
            .for_each(|shape| svg_shape(&mut svg, shape));
        svg + "</svg>\n"
    }

    /// As pixels, `scale` of them a px.
    pub fn to_canvas(&self, scale: f32) -> Canvas {
        let [w, h] = self.size_px.map(|v| (v * scale).round() as usize);
        let mut canvas = Canvas::new(w, h, self.background);
        self.shapes
            .iter()
            .for_each(|shape| draw_shape(&mut canvas, shape, scale));
        canvas
    }
}

fn hex([r, g, b]: Color) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
}

fn svg_shape(svg: &mut String, shape: &Shape) {
    // Writing to a String does not fail.
    let _ = match shape {
        Shape::Path {
            points,
            width_px,
            color,
            dashed,
        } => {
            let corners: Vec<String> = points
                .iter()
                .map(|[x, y]| format!("{x:.1},{y:.1}"))
                .collect();
            let dashes = match dashed {
                true => format!(" stroke-dasharray=\"{},{}\"", DASH_PX[0], DASH_PX[1]),
                false => String::new(),
            };
            writeln!(
                svg,
                "<polyline points=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"{width_px}\" stroke-linejoin=\"round\" \
                 stroke-linecap=\"round\"{dashes}/>",
                corners.join(" "),
                hex(*color)
            )
        }
        Shape::Dot {
            center: [x, y],
            radius_px,
            color,
        } => writeln!(
            svg,
            "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius_px}\" fill=\"{}\"/>",
            hex(*color)
        ),
        Shape::Rectangle { low, high, color } => writeln!(
            svg,
            "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{:.1}\" fill=\"{}\"/>",
            low[0],
            low[1],
            high[0] - low[0],
            high[1] - low[1],
            hex(*color)
        ),
        Shape::Text {
            at: [x, y],
            text,
            height_px,
            color,
            anchor,
        } => writeln!(
            svg,
            "<text x=\"{x:.1}\" y=\"{:.1}\" font-size=\"{:.1}\" fill=\"{}\" text-anchor=\"{}\">{}</text>",
            y + height_px / 2.0,
            // A capital is about 0.72 of the font's size.
            height_px / 0.72,
            hex(*color),
            ["start", "middle", "end"][*anchor as usize],
            escaped(text)
        ),
    };
}

fn draw_shape(canvas: &mut Canvas, shape: &Shape, scale: f32) {
    let at = |p: &[f32; 2]| p.map(|v| v * scale);
    match shape {
        Shape::Path {
            points,
            width_px,
            color,
            dashed,
        } => {
            let corners: Vec<[f32; 2]> = points.iter().map(at).collect();
            let dash = dashed.then(|| DASH_PX.map(|v| v * scale));
            draw_path(canvas, &corners, width_px * scale, *color, dash);
        }
        Shape::Dot {
            center,
            radius_px,
            color,
        } => canvas.line(at(center), at(center), 2.0 * radius_px * scale, *color, 1.0),
        Shape::Rectangle { low, high, color } => {
            let (low, high) = (at(low).map(|v| v as i64), at(high).map(|v| v as i64));
            canvas.rectangle(low, high, *color, 1.0);
        }
        Shape::Text {
            at: place,
            text,
            height_px,
            color,
            anchor,
        } => {
            let dots = (height_px * scale / 7.0).round().max(1.0) as usize;
            let size = Canvas::text_size_px(text, dots);
            let [x, y] = at(place).map(|v| v as i64);
            let left = match anchor {
                Anchor::Start => x,
                Anchor::Middle => x - size[0] / 2,
                Anchor::End => x - size[0],
            };
            canvas.text([left, y - size[1] / 2], text, dots, *color);
        }
    }
}

/// The dashes run on around corners.
fn draw_path(
    canvas: &mut Canvas,
    corners: &[[f32; 2]],
    width_px: f32,
    color: Color,
    dash: Option<[f32; 2]>,
) {
    let mut along = 0.0f32;
    for pair in corners.windows(2) {
        let (a, b) = (pair[0], pair[1]);
        let Some([on, off]) = dash else {
            canvas.line(a, b, width_px, color, 1.0);
            continue;
        };
        let length = (b[0] - a[0]).hypot(b[1] - a[1]);
        let mix = |t: f32| {
            [
                a[0] + (b[0] - a[0]) * t / length,
                a[1] + (b[1] - a[1]) * t / length,
            ]
        };
        let mut from = 0.0;
        while from < length {
            let phase = (along + from) % (on + off);
            let drawn = phase < on;
            // At least a tenth of a pixel, so that rounding cannot stop the walk.
            let to = (from + (if drawn { on } else { on + off } - phase).max(0.1)).min(length);
            if drawn {
                canvas.line(mix(from), mix(to), width_px, color, 1.0);
            }
            from = to;
        }
        along += length;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drawing() -> Drawing {
        let mut drawing = Drawing::new(100.0, 50.0);
        drawing.path(&[[10.0, 25.0], [90.0, 25.0]], 4.0, [255, 0, 0]);
        drawing.dot([50.0, 10.0], 3.0, [0, 0, 255]);
        drawing.text([50.0, 40.0], "a < b", 7.0, [0, 0, 0], Anchor::Middle);
        drawing
    }

    #[test]
    fn both_forms_hold_the_same_shapes() {
        let svg = drawing().to_svg();
        assert!(svg.contains("<polyline points=\"10.0,25.0 90.0,25.0\""));
        assert!(svg.contains(">a &lt; b</text>") && svg.ends_with("</svg>\n"));
        let canvas = drawing().to_canvas(2.0);
        assert_eq!(canvas.size_px(), [200, 100]);
        assert_eq!(canvas.pixel(100, 50), Some([255, 0, 0]));
        assert_eq!(canvas.pixel(100, 20), Some([0, 0, 255]));
        assert_eq!(canvas.pixel(2, 2), Some([255, 255, 255]));
    }

    #[test]
    fn a_dashed_line_has_gaps() {
        let mut drawing = Drawing::new(100.0, 20.0);
        drawing.shapes.push(Shape::Path {
            points: vec![[0.0, 10.0], [40.0, 10.0], [100.0, 10.0]],
            width_px: 2.0,
            color: [0, 0, 0],
            dashed: true,
        });
        let canvas = drawing.to_canvas(1.0);
        let dark = (0..100)
            .filter(|x| canvas.pixel(*x, 10).is_some_and(|p| p[0] < 60))
            .count();
        assert!((45..85).contains(&dark), "{dark}");
    }
}
