//! Pages of scenes, each from above and in perspective: the paper's figure 6 (one scene as labelled and as each method sees it, side
//! by side), and the frames in which a method did worst.

use super::perspective::Projection;
use super::scene::{DrawnScene, SceneBox, draw, paste};
use mluc_gateway::picture::{Canvas, Color, label_color};

const PAPER: Color = [250, 250, 250];
const INK: Color = [30, 30, 30];
const GAP_PX: usize = 8;
const FOOT_PX: usize = 34;

/// Pictures in rows and columns: each a scene from above with the same in perspective below it, lines of text over them.
struct Grid {
    head_px: usize,
    line_px: usize,
    /// Pixels of a dot of the letters.
    dot_px: usize,
    above_px: [usize; 2],
    eye_px: [usize; 2],
    px_per_m: f64,
}

impl Grid {
    /// Width and height of a picture with the gaps after it.
    fn cell_px(&self) -> [usize; 2] {
        let height = self.head_px + self.above_px[1] + self.eye_px[1] + 2 * GAP_PX;
        [self.above_px[0] + GAP_PX, height]
    }

    /// An empty page with what the colours mean at its foot.
    fn page(&self, columns: usize, rows: usize) -> Canvas {
        let [width, height] = self.cell_px();
        let mut canvas = Canvas::new(columns * width + GAP_PX, rows * height + FOOT_PX, PAPER);
        let (mut x, y) = (GAP_PX as i64, (rows * height) as i64 + 10);
        for name in ["car", "pedestrian", "cyclist", "truck", "unknown"] {
            canvas.rectangle([x, y], [x + 14, y + 14], label_color(name), 1.0);
            canvas.text([x + 20, y], name, 2, INK);
            x += 40 + Canvas::text_size_px(name, 2)[0];
        }
        canvas.text([x + 10, y], "white dashes: labelled unknown", 2, INK);
        canvas
    }

    /// Draws boxes over a scene's points; its unknown labels are dashed where `with_labels`.
    fn draw(
        &self,
        canvas: &mut Canvas,
        [column, row]: [usize; 2],
        lines: &[&str],
        (scene, boxes): (&DrawnScene, &[SceneBox]),
        with_labels: bool,
    ) {
        let [width, height] = self.cell_px();
        let (left, top) = (GAP_PX + column * width, row * height);
        for (line, text) in lines.iter().enumerate() {
            let at = [left, top + 8 + line * self.line_px].map(|v| v as i64);
            canvas.text(at, text, self.dot_px, INK);
        }
        let labels = scene.truth.iter();
        let labels: Vec<&SceneBox> = labels.filter(|l| l.unknown && with_labels).collect();
        let above = Projection::above(scene.target_m, self.px_per_m, self.above_px);
        let eye = Projection::towards(scene.target_m, self.eye_px);
        let top = top + self.head_px;
        for (projection, top) in [(above, top), (eye, top + self.above_px[1] + GAP_PX)] {
            let picture = draw(&scene.points, boxes, &labels, &projection);
            paste(canvas, &picture, left, top);
        }
    }
}

/// Draws scenes below each other: labels first, then a column a panel.
pub(crate) fn figure6(scenes: &[DrawnScene]) -> Canvas {
    let grid = Grid {
        head_px: 60,
        line_px: 30,
        dot_px: 2,
        above_px: [330, 300],
        eye_px: [330, 210],
        px_per_m: 8.0,
    };
    let panels = scenes.iter().map(|scene| scene.panels.len()).max();
    let mut canvas = grid.page(1 + panels.unwrap_or(0), scenes.len());
    for (row, scene) in scenes.iter().enumerate() {
        let labels = [&scene.caption, "Labels"];
        grid.draw(&mut canvas, [0, row], &labels, (scene, &scene.truth), false);
        for (column, panel) in scene.panels.iter().enumerate() {
            let (at, lines) = ([1 + column, row], ["", &panel.title]);
            grid.draw(&mut canvas, at, &lines, (scene, &panel.boxes), true);
        }
    }
    canvas
}

/// Draws the first panel of each scene, three a row, with the caption (two lines) over it.
pub(crate) fn worst_page(scenes: &[DrawnScene]) -> Canvas {
    const COLUMNS: usize = 3;
    let grid = Grid {
        head_px: 36,
        line_px: 14,
        dot_px: 1,
        above_px: [460, 380],
        eye_px: [460, 260],
        px_per_m: 7.0,
    };
    let mut canvas = grid.page(COLUMNS, scenes.len().div_ceil(COLUMNS).max(1));
    for (index, scene) in scenes.iter().enumerate() {
        let lines: Vec<&str> = scene.caption.lines().collect();
        let boxes = scene.panels.first().map_or(&[][..], |panel| &panel.boxes);
        let at = [index % COLUMNS, index / COLUMNS];
        grid.draw(&mut canvas, at, &lines, (scene, boxes), true);
    }
    canvas
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
