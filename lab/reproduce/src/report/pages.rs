//! Pages of scenes, each from above and in perspective: the paper's figure 6 (one scene as labelled and as each method sees it, side
//! by side), and the frames in which a method did worst.

use super::perspective::Projection;
use super::scene::{DrawnScene, SceneBox, draw, paste};
use mluc_gateway::picture::{Canvas, Color, label_color};

const PAPER: Color = [250, 250, 250];
const INK: Color = [30, 30, 30];
const GAP_PX: usize = 8;
const FOOT_PX: usize = 34;

/// A scene from above with the same in perspective below it.
struct Cell {
    above_px: [usize; 2],
    eye_px: [usize; 2],
    px_per_m: f64,
}

impl Cell {
    /// Width and height with the gaps after them.
    fn size_px(&self) -> [usize; 2] {
        let height = self.above_px[1] + self.eye_px[1] + 2 * GAP_PX;
        [self.above_px[0] + GAP_PX, height]
    }

    /// Draws boxes over a scene's points; its unknown labels are dashed where `with_labels`.
    fn draw(
        &self,
        canvas: &mut Canvas,
        scene: &DrawnScene,
        boxes: &[SceneBox],
        with_labels: bool,
        [left, top]: [usize; 2],
    ) {
        let labels = scene.truth.iter();
        let labels: Vec<&SceneBox> = labels.filter(|l| l.unknown && with_labels).collect();
        let above = Projection::above(scene.target_m, self.px_per_m, self.above_px);
        let eye = Projection::towards(scene.target_m, self.eye_px);
        let below = top + self.above_px[1] + GAP_PX;
        for (projection, top) in [(above, top), (eye, below)] {
            let picture = draw(&scene.points, boxes, &labels, &projection);
            paste(canvas, &picture, left, top);
        }
    }
}

/// Draws scenes below each other: labels first, then a column a panel.
pub(crate) fn figure6(scenes: &[DrawnScene]) -> Canvas {
    const CELL: Cell = Cell {
        above_px: [330, 300],
        eye_px: [330, 210],
        px_per_m: 8.0,
    };
    const HEAD_PX: usize = 30;
    let [cell_width, cell_height] = CELL.size_px();
    let panels = scenes.iter().map(|scene| scene.panels.len()).max();
    let columns = 1 + panels.unwrap_or(0);
    let scene_px = 2 * HEAD_PX + cell_height;
    let width = columns * cell_width + GAP_PX;
    let mut canvas = Canvas::new(width, scenes.len() * scene_px + FOOT_PX, PAPER);
    for (row, scene) in scenes.iter().enumerate() {
        let top = row * scene_px;
        canvas.text([GAP_PX as i64, top as i64 + 9], &scene.caption, 2, INK);
        let found = scene.panels.iter().map(|p| (p.title.as_str(), &p.boxes));
        let panels = std::iter::once(("Labels", &scene.truth)).chain(found);
        for (column, (title, boxes)) in panels.enumerate() {
            let left = GAP_PX + column * cell_width;
            let heading = [left as i64 + 4, (top + HEAD_PX) as i64 + 8];
            canvas.text(heading, title, 2, INK);
            let at = [left, top + 2 * HEAD_PX];
            CELL.draw(&mut canvas, scene, boxes, column > 0, at);
        }
    }
    draw_legend(&mut canvas, scenes.len() * scene_px);
    canvas
}

/// Draws the first panel of each scene, three a row, with the caption (two lines) over it.
pub(crate) fn worst_page(scenes: &[DrawnScene]) -> Canvas {
    const CELL: Cell = Cell {
        above_px: [460, 380],
        eye_px: [460, 260],
        px_per_m: 7.0,
    };
    const HEAD_PX: usize = 36;
    const COLUMNS: usize = 3;
    let [cell_width, cell_height] = CELL.size_px();
    let row_px = HEAD_PX + cell_height;
    let rows = scenes.len().div_ceil(COLUMNS).max(1);
    let mut canvas = Canvas::new(
        COLUMNS * cell_width + GAP_PX,
        rows * row_px + FOOT_PX,
        PAPER,
    );
    for (index, scene) in scenes.iter().enumerate() {
        let left = GAP_PX + index % COLUMNS * cell_width;
        let top = index / COLUMNS * row_px;
        for (line, text) in scene.caption.lines().enumerate() {
            canvas.text([left as i64, (top + 8 + 14 * line) as i64], text, 1, INK);
        }
        let boxes = scene.panels.first().map_or(&[][..], |panel| &panel.boxes);
        CELL.draw(&mut canvas, scene, boxes, true, [left, top + HEAD_PX]);
    }
    draw_legend(&mut canvas, rows * row_px);
    canvas
}

/// What the colours mean.
fn draw_legend(canvas: &mut Canvas, top: usize) {
    let (mut x, y) = (GAP_PX as i64, top as i64 + 10);
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
    use crate::report::Panel;
    use mluc_geometry::Box3;

    fn scene() -> DrawnScene {
        DrawnScene {
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
        }
    }

    #[test]
    fn figure_6_has_two_pictures_a_scene_and_a_column_a_panel() {
        let canvas = figure6(&[scene()]);
        assert_eq!(canvas.size_px(), [2 * 338 + 8, 60 + 300 + 210 + 16 + 34]);
        // Red in the labels' column, white dashes in the method's.
        let reds = |from: usize| {
            let pixels = (60..360).flat_map(|y| (from..from + 330).map(move |x| (x, y)));
            let is_red = |c: Color| c[0] > 200 && c[1] < 120 && c[2] < 120;
            let red = pixels.filter(|(x, y)| canvas.pixel(*x, *y).is_some_and(is_red));
            red.count()
        };
        assert!(reds(8) > 50 && reds(346) == 0);
    }

    #[test]
    fn the_page_of_the_worst_has_three_frames_a_row() {
        let size = |count: usize| worst_page(&vec![scene(); count]).size_px();
        assert_eq!(size(3)[1], size(1)[1]);
        assert_eq!(size(4)[1] - FOOT_PX, 2 * (size(3)[1] - FOOT_PX));
    }
}
