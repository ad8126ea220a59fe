//! A page of the frames in which a method did worst: what was labelled, what was found, what went wrong.

use super::figure6::legend;
use super::perspective::Projection;
use super::scene::{Scene, SceneBox, draw, paste};
use mluc_gateway::picture::{Canvas, Color};

const ABOVE_PX: [usize; 2] = [460, 380];
const EYE_PX: [usize; 2] = [460, 260];
const GAP_PX: usize = 8;
const HEAD_PX: usize = 36;
const LINE_PX: usize = 14;
const COLUMNS: usize = 3;
const PX_PER_M: f64 = 7.0;
const PAPER: Color = [250, 250, 250];
const INK: Color = [30, 30, 30];

/// Draws the first panel of each scene, three a row, from above and in perspective, the caption (two lines) over it.
pub fn worst(scenes: &[Scene]) -> Canvas {
    let rows = scenes.len().div_ceil(COLUMNS).max(1);
    let cell = [
        ABOVE_PX[0] + GAP_PX,
        HEAD_PX + ABOVE_PX[1] + EYE_PX[1] + 2 * GAP_PX,
    ];
    let mut canvas = Canvas::new(COLUMNS * cell[0] + GAP_PX, rows * cell[1] + 34, PAPER);
    for (index, scene) in scenes.iter().enumerate() {
        let left = GAP_PX + index % COLUMNS * cell[0];
        let top = index / COLUMNS * cell[1];
        for (line, text) in scene.caption.lines().enumerate() {
            let y = top + 8 + line * LINE_PX;
            canvas.text([left as i64, y as i64], text, 1, INK);
        }
        let labelled: Vec<&SceneBox> = scene.truth.iter().filter(|label| label.unknown).collect();
        let boxes = scene.panels.first().map_or(&[][..], |panel| &panel.boxes);
        let above = Projection::above(scene.target_m, PX_PER_M, ABOVE_PX);
        let eye = Projection::towards(scene.target_m, EYE_PX);
        let top = top + HEAD_PX;
        paste(
            &mut canvas,
            &draw(&scene.points, boxes, &labelled, &above),
            left,
            top,
        );
        let below = top + ABOVE_PX[1] + GAP_PX;
        paste(
            &mut canvas,
            &draw(&scene.points, boxes, &labelled, &eye),
            left,
            below,
        );
    }
    legend(&mut canvas, rows * cell[1]);
    canvas
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_frames_a_row() {
        let scene = Scene {
            caption: "frame 1: 1 missed".into(),
            points: Vec::new(),
            truth: Vec::new(),
            panels: Vec::new(),
            target_m: [10.0, 0.0],
        };
        let size = |count: usize| worst(&vec![scene.clone(); count]).size_px();
        assert_eq!(size(3)[1], size(1)[1]);
        assert_eq!(size(4)[1] - 34, 2 * (size(3)[1] - 34));
    }
}
