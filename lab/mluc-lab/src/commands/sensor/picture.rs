//! Elevations of some scans' returns beside the beams of another sensor.

use mluc_gateway::picture::{Canvas, Color};
use mluc_ingest::estimate::SensorEstimate;
use mluc_ingest::estimate::elevations::bin_deg;
use mluc_model::SensorProfile;

const GROUND: Color = [11, 15, 22];
const TEXT: Color = [168, 180, 196];
const RETURNS: Color = [38, 130, 176];
const BEAM: Color = [244, 196, 72];
const OTHER: Color = [52, 176, 138];
/// Picture and plot, px.
const SIZE: [usize; 2] = [900, 760];
const TOP: f32 = 60.0;
const HEIGHT: f32 = 670.0;
const LEFT: f32 = 70.0;
const HISTOGRAM: f32 = 480.0;
const COLUMN: f32 = 120.0;
/// Around the outermost elevation, degrees.
const MARGIN_DEG: f32 = 2.0;

/// Left the returns by elevation and the beams found in them, right the other sensor's.
pub(super) fn draw(
    counts: &[u32],
    found: &SensorEstimate,
    name: &str,
    other: &SensorProfile,
) -> Canvas {
    let mut canvas = Canvas::new(SIZE[0], SIZE[1], GROUND);
    let ends = other.elevations_deg.iter().chain(&found.vertical_field_deg);
    let high = ends.clone().copied().fold(f32::MIN, f32::max) + MARGIN_DEG;
    let low = ends.copied().fold(f32::MAX, f32::min) - MARGIN_DEG;
    let y_of = |deg: f32| TOP + (high - deg) / (high - low) * HEIGHT;
    let step_deg = if high - low > 60.0 { 10 } else { 5 };
    for deg in (-90..=90).filter(|deg| deg % step_deg == 0) {
        let y = y_of(deg as f32);
        if (TOP..=TOP + HEIGHT).contains(&y) {
            canvas.line([LEFT, y], [SIZE[0] as f32 - 20.0, y], 1.0, TEXT, 0.2);
            canvas.text([14, y as i64 - 7], &deg.to_string(), 2, TEXT);
        }
    }
    // Returns of a row of pixels, by their square root: thin beams stay visible.
    let mut rows = [0u32; SIZE[1]];
    for (bin, count) in counts.iter().enumerate() {
        let y = y_of(bin_deg(bin));
        if (TOP..TOP + HEIGHT).contains(&y) {
            rows[y as usize] += count;
        }
    }
    let most = rows.iter().copied().max().unwrap_or(0).max(1) as f32;
    for (y, count) in rows.iter().enumerate().filter(|(_, count)| **count > 0) {
        let length = (*count as f32 / most).sqrt() * HISTOGRAM;
        let [from, to] = [LEFT, LEFT + length].map(|x| x as i64);
        canvas.rectangle([from, y as i64], [to, y as i64 + 1], RETURNS, 1.0);
    }
    let right = LEFT + HISTOGRAM;
    let columns = [
        (right + 15.0, &found.elevations_deg, BEAM),
        (right + 30.0 + COLUMN, &other.elevations_deg, OTHER),
    ];
    for (x, elevations_deg, color) in columns {
        for &deg in elevations_deg {
            canvas.line([x, y_of(deg)], [x + COLUMN, y_of(deg)], 1.0, color, 1.0);
        }
    }
    let title = |canvas: &mut Canvas, x: f32, text: &str, color| {
        canvas.text([x as i64, 22], text, 2, color);
    };
    let scans = format!("returns of {} scans by elevation", found.scans);
    title(&mut canvas, LEFT, &scans, RETURNS);
    let beams = format!("{} found", found.elevations_deg.len());
    title(&mut canvas, columns[0].0, &beams, BEAM);
    title(&mut canvas, columns[1].0, name, OTHER);
    canvas
}
