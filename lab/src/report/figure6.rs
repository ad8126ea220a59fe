//! The paper's figure 6: one scene as labelled and as each method sees it, side by side, from above and in perspective.

use super::perspective::Projection;
use super::scene::{Panel, Scene, SceneBox, draw, paste};
use mluc_gateway::picture::{Canvas, Color, label_color};

const PANEL_PX: [usize; 2] = [330, 300];
const EYE_PX: [usize; 2] = [330, 210];
const GAP_PX: usize = 6;
const HEAD_PX: usize = 30;
const FOOT_PX: usize = 34;
const PX_PER_M: f64 = 8.0;
const PAPER: Color = [250, 250, 250];
const INK: Color = [30, 30, 30];

/// Draws scenes below each other: labels first, then a column a panel.
pub fn figure6(scenes: &[Scene]) -> Canvas {
    let columns = 1 + scenes
        .iter()
        .map(|scene| scene.panels.len())
        .max()
        .unwrap_or(0);
    let scene_px = 2 * HEAD_PX + PANEL_PX[1] + EYE_PX[1] + 2 * GAP_PX;
    let width = columns * (PANEL_PX[0] + GAP_PX) + GAP_PX;
    let mut canvas = Canvas::new(width, scenes.len() * scene_px + FOOT_PX, PAPER);
    for (row, scene) in scenes.iter().enumerate() {
        let top = row * scene_px;
        canvas.text([GAP_PX as i64 + 4, top as i64 + 9], &scene.caption, 2, INK);
        let truth = Panel {
            title: "Labels".to_owned(),
            boxes: scene.truth.clone(),
        };
        let panels = std::iter::once(&truth).chain(&scene.panels);
        for (column, panel) in panels.enumerate() {
            let left = GAP_PX + column * (PANEL_PX[0] + GAP_PX);
            let heading = [left as i64 + 4, (top + HEAD_PX) as i64 + 8];
            canvas.text(heading, &panel.title, 2, INK);
            let labelled: Vec<&SceneBox> = match column {
                0 => Vec::new(),
                _ => scene.truth.iter().filter(|label| label.unknown).collect(),
            };
            let above = Projection::above(scene.target_m, PX_PER_M, PANEL_PX);
            let eye = Projection::towards(scene.target_m, EYE_PX);
            let top = top + 2 * HEAD_PX;
            let picture = draw(&scene.points, &panel.boxes, &labelled, &above);
            paste(&mut canvas, &picture, left, top);
            let picture = draw(&scene.points, &panel.boxes, &labelled, &eye);
            paste(&mut canvas, &picture, left, top + PANEL_PX[1] + GAP_PX);
        }
    }
    legend(&mut canvas, scenes.len() * scene_px);
    canvas
}

/// What the colours mean.
pub(super) fn legend(canvas: &mut Canvas, top: usize) {
    let (mut x, y) = (GAP_PX as i64 + 4, top as i64 + 10);
    for name in ["car", "pedestrian", "cyclist", "truck", "unknown"] {
        canvas.rectangle([x, y], [x + 14, y + 14], label_color(name), 1.0);
        canvas.text([x + 20, y], name, 2, INK);
        x += 40 + Canvas::text_size_px(name, 2)[0];
    }
    canvas.text([x + 10, y], "white dashes: labelled unknown", 2, INK);
}

#[cfg(test)]
mod tests {
    use super::*;
    use mluc_geometry::Box3;

    #[test]
    fn a_scene_has_two_rows_and_a_column_a_panel() {
        let scene = Scene {
            caption: "sim-udi, frame 3".into(),
            points: vec![[10.0, 0.0, -1.0, 0.0]],
            truth: vec![SceneBox {
                class: "golf_cart".into(),
                unknown: true,
                bounds: Box3::new([12.0, 0.0, -1.0, 2.4, 1.3, 1.9, 0.3]),
            }],
            panels: vec![Panel {
                title: "MLUC".into(),
                boxes: Vec::new(),
            }],
            target_m: [12.0, 0.0],
        };
        let canvas = figure6(&[scene]);
        assert_eq!(canvas.size_px(), [2 * 336 + 6, 60 + 300 + 210 + 12 + 34]);
        // Red in the labels' column, white dashes in the method's.
        let reds = |from: usize| {
            let pixels = (60..360).flat_map(|y| (from..from + 330).map(move |x| (x, y)));
            let is_red = |c: Color| c[0] > 200 && c[1] < 120 && c[2] < 120;
            pixels
                .filter(|(x, y)| canvas.pixel(*x, *y).is_some_and(is_red))
                .count()
        };
        assert!(reds(6) > 50 && reds(342) == 0);
    }
}
