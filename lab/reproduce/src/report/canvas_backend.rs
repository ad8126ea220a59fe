//! plotters on the workspace's canvas: lines and text; plotters makes the rest of pixels.

use mluc_gateway::picture::Canvas;
use plotters::prelude::DrawingBackend;
use plotters_backend::text_anchor::{HPos, VPos};
use plotters_backend::{
    BackendColor, BackendCoord, BackendStyle, BackendTextStyle, DrawingErrorKind,
};
use std::convert::Infallible;

type Outcome = Result<(), DrawingErrorKind<Infallible>>;

pub(super) struct CanvasBackend<'a>(pub(super) &'a mut Canvas);

/// Pixels of a dot of the canvas' letters, for a font of this size.
fn dot_px(style: &impl BackendTextStyle) -> usize {
    // A capital is about 0.72 of the font's size, and seven dots high.
    (0.72 * style.size() / 7.0).round().max(1.0) as usize
}

impl DrawingBackend for CanvasBackend<'_> {
    type ErrorType = Infallible;

    fn get_size(&self) -> (u32, u32) {
        let [width, height] = self.0.size_px();
        (width as u32, height as u32)
    }

    fn ensure_prepared(&mut self) -> Outcome {
        Ok(())
    }

    fn present(&mut self) -> Outcome {
        Ok(())
    }

    fn draw_pixel(&mut self, (x, y): BackendCoord, color: BackendColor) -> Outcome {
        let color_rgb = color.rgb.into();
        self.0
            .blend(x.into(), y.into(), color_rgb, color.alpha as f32);
        Ok(())
    }

    /// plotters' own makes spikes of sharp turns.
    fn draw_path<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(
        &mut self,
        path: I,
        style: &S,
    ) -> Outcome {
        let corner = |(x, y): BackendCoord| [x as f32, y as f32];
        let corners: Vec<[f32; 2]> = path.into_iter().map(corner).collect();
        let (color, width) = (style.color(), style.stroke_width() as f32);
        let (rgb, alpha) = (color.rgb.into(), color.alpha as f32);
        for pair in corners.windows(2) {
            self.0.line(pair[0], pair[1], width, rgb, alpha);
        }
        Ok(())
    }

    fn draw_text<T: BackendTextStyle>(
        &mut self,
        text: &str,
        style: &T,
        (x, y): BackendCoord,
    ) -> Outcome {
        let [width, height] = Canvas::text_size_px(text, dot_px(style));
        let left = match style.anchor().h_pos {
            HPos::Left => 0,
            HPos::Center => width / 2,
            HPos::Right => width,
        };
        let top = match style.anchor().v_pos {
            VPos::Top => 0,
            VPos::Center => height / 2,
            VPos::Bottom => height,
        };
        let at = [i64::from(x) - left, i64::from(y) - top];
        self.0
            .text(at, text, dot_px(style), style.color().rgb.into());
        Ok(())
    }

    fn estimate_text_size<T: BackendTextStyle>(
        &self,
        text: &str,
        style: &T,
    ) -> Result<(u32, u32), DrawingErrorKind<Infallible>> {
        let [width, height] = Canvas::text_size_px(text, dot_px(style));
        Ok((width as u32, height as u32))
    }
}
