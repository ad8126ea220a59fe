//! plotters on the workspace's canvas.

use mluc_gateway::picture::{Canvas, Color};
use plotters::prelude::DrawingBackend;
use plotters_backend::text_anchor::{HPos, VPos};
use plotters_backend::{
    BackendColor, BackendCoord, BackendStyle, BackendTextStyle, DrawingErrorKind,
};
use std::convert::Infallible;

type Outcome = Result<(), DrawingErrorKind<Infallible>>;

/// Draws with so many pixels a unit of the chart.
pub(super) struct CanvasBackend<'a> {
    pub(super) canvas: &'a mut Canvas,
    pub(super) scale: f32,
}

impl CanvasBackend<'_> {
    fn at(&self, (x, y): BackendCoord) -> [f32; 2] {
        [x as f32 * self.scale, y as f32 * self.scale]
    }

    fn line(&mut self, from: BackendCoord, to: BackendCoord, width: f32, color: BackendColor) {
        let (from, to) = (self.at(from), self.at(to));
        let (color, alpha) = split(color);
        self.canvas.line(from, to, width * self.scale, color, alpha);
    }

    /// Pixels of a dot of the canvas' letters, for a font of this size.
    fn dot_px(&self, font_size: f64) -> usize {
        // A capital is about 0.72 of the font's size, and seven dots high.
        (0.72 * font_size as f32 * self.scale / 7.0)
            .round()
            .max(1.0) as usize
    }
}

fn split(BackendColor { alpha, rgb }: BackendColor) -> (Color, f32) {
    let (r, g, b) = rgb;
    ([r, g, b], alpha as f32)
}

impl DrawingBackend for CanvasBackend<'_> {
    type ErrorType = Infallible;

    fn get_size(&self) -> (u32, u32) {
        let [width, height] = self.canvas.size_px().map(|v| v as f32 / self.scale);
        (width as u32, height as u32)
    }

    fn ensure_prepared(&mut self) -> Outcome {
        Ok(())
    }

    fn present(&mut self) -> Outcome {
        Ok(())
    }

    fn draw_pixel(&mut self, point: BackendCoord, color: BackendColor) -> Outcome {
        self.line(point, point, 1.0, color);
        Ok(())
    }

    fn draw_path<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(
        &mut self,
        path: I,
        style: &S,
    ) -> Outcome {
        let corners: Vec<BackendCoord> = path.into_iter().collect();
        for pair in corners.windows(2) {
            self.line(pair[0], pair[1], style.stroke_width() as f32, style.color());
        }
        Ok(())
    }

    fn draw_circle<S: BackendStyle>(
        &mut self,
        center: BackendCoord,
        radius: u32,
        style: &S,
        _fill: bool,
    ) -> Outcome {
        self.line(center, center, 2.0 * radius as f32, style.color());
        Ok(())
    }

    fn draw_text<T: BackendTextStyle>(
        &mut self,
        text: &str,
        style: &T,
        place: BackendCoord,
    ) -> Outcome {
        let dot_px = self.dot_px(style.size());
        let [width, height] = Canvas::text_size_px(text, dot_px);
        let [x, y] = self.at(place).map(|v| v as i64);
        let left = match style.anchor().h_pos {
            HPos::Left => x,
            HPos::Center => x - width / 2,
            HPos::Right => x - width,
        };
        let top = match style.anchor().v_pos {
            VPos::Top => y,
            VPos::Center => y - height / 2,
            VPos::Bottom => y - height,
        };
        let (color, _) = split(style.color());
        self.canvas.text([left, top], text, dot_px, color);
        Ok(())
    }

    fn estimate_text_size<T: BackendTextStyle>(
        &self,
        text: &str,
        style: &T,
    ) -> Result<(u32, u32), DrawingErrorKind<Infallible>> {
        let size = Canvas::text_size_px(text, self.dot_px(style.size()));
        let [width, height] = size.map(|v| (v as f32 / self.scale).ceil() as u32);
        Ok((width, height))
    }
}
