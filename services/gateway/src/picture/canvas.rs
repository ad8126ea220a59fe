//! Pixels: blending, anti-aliased lines and rings, text, PNG.

use super::font::{GLYPH_COLUMNS, GLYPH_ROWS, glyph};

/// Red, green, blue, 0..255.
pub type Color = [u8; 3];

/// A picture in memory, 8-bit RGB, row by row from the top.
#[derive(Clone, Debug)]
pub struct Canvas {
    width_px: usize,
    height_px: usize,
    pixels: Vec<Color>,
}

impl Canvas {
    /// A picture of one colour; its sides are clamped to 1..=8192 px.
    pub fn new(width_px: usize, height_px: usize, background: Color) -> Canvas {
        let (width_px, height_px) = (width_px.clamp(1, 8192), height_px.clamp(1, 8192));
        Canvas { width_px, height_px, pixels: vec![background; width_px * height_px] }
    }

    /// Width and height, px.
    pub fn size_px(&self) -> [usize; 2] {
        [self.width_px, self.height_px]
    }

    /// Colour of a pixel, None outside.
    pub fn pixel(&self, x: usize, y: usize) -> Option<Color> {
        (x < self.width_px && y < self.height_px).then(|| self.pixels[y * self.width_px + x])
    }

    /// Mixes a colour into a pixel; `alpha` 0 leaves it, 1 replaces it. A pixel outside the picture is ignored.
    pub fn blend(&mut self, x: i64, y: i64, color: Color, alpha: f32) {
        let (x, y) = (x as usize, y as usize);
        // A coordinate below 0 wraps to a value that is larger than any side.
        if x >= self.width_px || y >= self.height_px {
            return;
        }
        let pixel = &mut self.pixels[y * self.width_px + x];
        let alpha = alpha.clamp(0.0, 1.0);
        for (old, new) in pixel.iter_mut().zip(color) {
            *old = (f32::from(*old) + (f32::from(new) - f32::from(*old)) * alpha).round() as u8;
        }
    }

    /// A filled rectangle, corners in px.
    pub fn rectangle(&mut self, low: [i64; 2], high: [i64; 2], color: Color, alpha: f32) {
        let corners = [low, high].map(|corner| corner.map(|v| v as f32));
        self.paint(corners, color, alpha, |_| 1.0);
    }

    /// An anti-aliased line with round ends: every pixel is covered by its distance from the segment.
    pub fn line(&mut self, from: [f32; 2], to: [f32; 2], width_px: f32, color: Color, alpha: f32) {
        let reach = width_px / 2.0 + 1.0;
        let low = [0, 1].map(|axis| from[axis].min(to[axis]) - reach);
        let high = [0, 1].map(|axis| from[axis].max(to[axis]) + reach);
        self.paint([low, high], color, alpha, |p| {
            width_px / 2.0 + 0.5 - distance_to_segment(p, from, to)
        });
    }

    /// A filled convex polygon without smoothing; its outline hides the edge.
    pub fn polygon(&mut self, corners: &[[f32; 2]], color: Color, alpha: f32) {
        let bound = |pick: fn(f32, f32) -> f32, start: f32| {
            [0, 1].map(|axis| corners.iter().map(|c| c[axis]).fold(start, pick))
        };
        let bounds = [bound(f32::min, f32::MAX), bound(f32::max, f32::MIN)];
        self.paint(bounds, color, alpha, |p| f32::from(inside(corners, p)));
    }

    /// An anti-aliased circle.
    pub fn ring(&mut self, at: [f32; 2], radius_px: f32, width_px: f32, color: Color, alpha: f32) {
        let reach = radius_px + width_px + 1.0;
        let bounds = [at.map(|v| v - reach), at.map(|v| v + reach)];
        self.paint(bounds, color, alpha, |p| {
            let from_center = (p[0] - at[0]).hypot(p[1] - at[1]);
            width_px / 2.0 + 0.5 - (from_center - radius_px).abs()
        });
    }

    /// Text with its upper left corner at a place; capitals, digits and common signs. `scale` is px per dot.
    pub fn text(&mut self, at: [i64; 2], text: &str, scale: usize, color: Color) {
        let scale = scale.clamp(1, 16) as i64;
        for (index, letter) in text.chars().enumerate() {
            let left = at[0] + index as i64 * (GLYPH_COLUMNS as i64 + 1) * scale;
            for (row, bits) in glyph(letter).into_iter().enumerate() {
                let is_dot = |column: &usize| bits >> (GLYPH_COLUMNS - 1 - column) & 1 == 1;
                for column in (0..GLYPH_COLUMNS).filter(is_dot) {
                    let (x, y) = (left + column as i64 * scale, at[1] + row as i64 * scale);
                    self.rectangle([x, y], [x + scale, y + scale], color, 1.0);
                }
            }
        }
    }

    /// Width and height of a text, px.
    pub fn text_size_px(text: &str, scale: usize) -> [i64; 2] {
        let dots = text.chars().count() * (GLYPH_COLUMNS + 1);
        [dots.saturating_sub(1), GLYPH_ROWS].map(|dots| (dots * scale) as i64)
    }

    /// The picture as a PNG file.
    pub fn png(&self) -> Vec<u8> {
        Canvas::animation(std::slice::from_ref(self), 0)
    }

    /// An animated PNG that shows pictures of one size in an endless loop; a single picture gives a plain PNG.
    pub fn animation(pictures: &[Canvas], each_ms: u16) -> Vec<u8> {
        let mut file = Vec::new();
        let [width, height] = pictures[0].size_px().map(|side| side as u32);
        let mut encoder = png::Encoder::new(&mut file, width, height);
        encoder.set_color(png::ColorType::Rgb);
        if pictures.len() > 1 {
            let animated = encoder.set_animated(pictures.len() as u32, 0);
            let delayed = animated.and_then(|()| encoder.set_frame_delay(each_ms, 1000));
            delayed.expect("more than one picture");
        }
        let mut writer = encoder.write_header().expect("sides above 0, room in memory");
        for picture in pictures {
            let written = writer.write_image_data(picture.pixels.as_flattened());
            written.expect("as many pixels as the header says");
        }
        writer.finish().expect("as many pictures as it says");
        file
    }

    /// Copies another picture into this one; `at` is the place of its upper left corner, px.
    pub fn paste(&mut self, other: &Canvas, at: [usize; 2]) {
        for (y, row) in other.pixels.chunks(other.width_px).enumerate() {
            for (x, color) in row.iter().enumerate() {
                self.blend((at[0] + x) as i64, (at[1] + y) as i64, *color, 1.0);
            }
        }
    }

    /// Blends each pixel between two corners in proportion to its coverage; `cover` is clamped to 0..1.
    fn paint(
        &mut self,
        [low, high]: [[f32; 2]; 2],
        color: Color,
        alpha: f32,
        cover: impl Fn([f32; 2]) -> f32,
    ) {
        let [left, top] = low.map(|v| v.floor().max(0.0) as i64);
        let [right, bottom] = high.map(|v| v.ceil() as i64);
        for y in top..bottom.min(self.height_px as i64) {
            for x in left..right.min(self.width_px as i64) {
                let cover = cover([x as f32 + 0.5, y as f32 + 0.5]).clamp(0.0, 1.0);
                if cover > 0.0 {
                    self.blend(x, y, color, alpha * cover);
                }
            }
        }
    }
}

fn distance_to_segment(p: [f32; 2], a: [f32; 2], b: [f32; 2]) -> f32 {
    let (d, q) = ([b[0] - a[0], b[1] - a[1]], [p[0] - a[0], p[1] - a[1]]);
    let length = d[0] * d[0] + d[1] * d[1];
    let along = ((q[0] * d[0] + q[1] * d[1]) / length).clamp(0.0, 1.0);
    let t = if length > 0.0 { along } else { 0.0 };
    (q[0] - t * d[0]).hypot(q[1] - t * d[1])
}

/// Whether a point lies on the same side of all edges.
fn inside(corners: &[[f32; 2]], p: [f32; 2]) -> bool {
    let side = |i: usize| {
        let (a, b) = (corners[i], corners[(i + 1) % corners.len()]);
        (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])
    };
    let positive = (0..corners.len()).filter(|i| side(*i) >= 0.0).count();
    positive == 0 || positive == corners.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    const BLACK: Color = [0, 0, 0];
    const WHITE: Color = [255, 255, 255];

    #[test]
    fn a_line_is_bright_on_its_path_and_dark_beside_it() {
        let mut canvas = Canvas::new(20, 10, BLACK);
        canvas.line([2.0, 5.0], [18.0, 5.0], 2.0, WHITE, 1.0);
        assert_eq!(canvas.pixel(10, 5), Some(WHITE));
        assert_eq!(canvas.pixel(10, 9), Some(BLACK));
        canvas.line([-50.0, -50.0], [-20.0, -20.0], 3.0, WHITE, 1.0);
        assert_eq!(canvas.pixel(0, 0), Some(BLACK));
    }

    #[test]
    fn polygons_fill_and_rings_do_not() {
        let mut canvas = Canvas::new(40, 40, BLACK);
        let corners = [[5.0, 5.0], [35.0, 5.0], [35.0, 35.0], [5.0, 35.0]];
        canvas.polygon(&corners, WHITE, 1.0);
        assert_eq!(canvas.pixel(20, 20), Some(WHITE));
        let mut canvas = Canvas::new(40, 40, BLACK);
        canvas.ring([20.0, 20.0], 10.0, 2.0, WHITE, 1.0);
        assert_eq!(canvas.pixel(20, 20), Some(BLACK));
        assert!(canvas.pixel(30, 20).expect("inside")[0] > 100);
    }

    #[test]
    fn a_png_reads_back() {
        let mut canvas = Canvas::new(7, 5, [10, 20, 30]);
        canvas.text([0, 0], "A", 1, WHITE);
        let decoder = png::Decoder::new(std::io::Cursor::new(canvas.png()));
        let mut reader = decoder.read_info().expect("a PNG");
        let mut pixels = vec![0; reader.output_buffer_size().expect("a size")];
        let info = reader.next_frame(&mut pixels).expect("a frame");
        assert_eq!((info.width, info.height), (7, 5));
        assert_eq!(pixels, canvas.pixels.as_flattened());
    }
}
