//! The legend in a picture's corner: the title, one line per kind of box with its count, the height ramp.

use super::canvas::{Canvas, Color};
use super::view::{BoxKind, CAPTION, DrawnBox, NIGHT, color_of, ramp};

const MARGIN_PX: i64 = 14;
const LINE_PX: i64 = 18;
const TITLE: Color = [230, 236, 244];
const RAMP_PX: i64 = 180;

/// Draws the legend on panels that dim what is under them.
pub(super) fn draw_legend(canvas: &mut Canvas, boxes: &[DrawnBox], title: &str, ramp_m: [f32; 2]) {
    let lines = lines(boxes);
    let title_px = if title.is_empty() { 0 } else { 24 };
    let texts = lines.iter().map(|(_, text)| text);
    let widths = texts.map(|text| Canvas::text_size_px(text, 1)[0] + 20);
    let width = widths.fold(Canvas::text_size_px(title, 2)[0], i64::max);
    let height = title_px + lines.len() as i64 * LINE_PX;
    if height > 0 {
        let end = [MARGIN_PX + width + 10, MARGIN_PX + height + 2];
        canvas.rectangle([4, 4], end, NIGHT, 0.78);
    }
    canvas.text([MARGIN_PX, MARGIN_PX], title, 2, TITLE);
    let mut y = MARGIN_PX + title_px;
    for (color, text) in lines {
        canvas.rectangle([MARGIN_PX, y], [MARGIN_PX + 12, y + 12], color, 0.9);
        canvas.text([MARGIN_PX + 20, y + 3], &text, 1, CAPTION);
        y += LINE_PX;
    }
    draw_ramp(canvas, ramp_m);
}

/// One line for each label and kind, in the order of their first box.
fn lines(boxes: &[DrawnBox]) -> Vec<(Color, String)> {
    let mut seen: Vec<(&DrawnBox, usize)> = Vec::new();
    for drawn in boxes {
        let is_same = |first: &DrawnBox| first.label == drawn.label && first.kind == drawn.kind;
        match seen.iter_mut().find(|(first, _)| is_same(first)) {
            Some(entry) => entry.1 += 1,
            None => seen.push((drawn, 1)),
        }
    }
    let line = |(first, count): (&DrawnBox, usize)| {
        let what = match first.kind {
            BoxKind::Known => "known",
            BoxKind::Unknown => "unknown",
            BoxKind::Truth => "label",
        };
        let label = first.label.replace('_', " ");
        let mut text = format!("{count} {label}");
        if !label.eq_ignore_ascii_case(what) {
            text += &format!(" ({what})");
        }
        (color_of(first), text)
    };
    seen.into_iter().map(line).collect()
}

fn draw_ramp(canvas: &mut Canvas, ramp_m: [f32; 2]) {
    let top = canvas.size_px()[1] as i64 - 34;
    let end = [MARGIN_PX + RAMP_PX + 10, top + 30];
    canvas.rectangle([4, top - 8], end, NIGHT, 0.78);
    for i in 0..RAMP_PX {
        let (x, color) = (MARGIN_PX + i, ramp(i as f32 / RAMP_PX as f32));
        canvas.rectangle([x, top], [x + 1, top + 8], color, 1.0);
    }
    let [low, high] = ramp_m;
    let (low, high) = (format!("{low:.1} m"), format!("+{high:.1} m"));
    for (text, halves) in [&low, "height", &high].into_iter().zip(0..) {
        let room = RAMP_PX - Canvas::text_size_px(text, 1)[0];
        canvas.text([MARGIN_PX + room * halves / 2, top + 14], text, 1, CAPTION);
    }
}
