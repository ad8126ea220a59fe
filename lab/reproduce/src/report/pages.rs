//! Pages of scenes, each from above and in perspective: the paper's figure 6 (one scene as labelled and as each method sees it, side
//! by side), and the frames in which a method did worst.

use super::perspective::Projection;
use super::scene::{DrawnScene, draw, paste};
use mluc_evaluate::{ObjectKind, SensorDetection};
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
    width_px: usize,
    /// Heights of the picture from above and of the one in perspective.
    heights_px: [usize; 2],
    px_per_m: f64,
}

impl Grid {
    /// Width and height of a picture with the gaps after it.
    fn cell_px(&self) -> [usize; 2] {
        let [above, eye] = self.heights_px;
        [
            self.width_px + GAP_PX,
            self.head_px + above + eye + 2 * GAP_PX,
        ]
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
        (scene, boxes): (&DrawnScene, &[SensorDetection]),
        with_labels: bool,
    ) {
        let [width, height] = self.cell_px();
        let (left, top) = (GAP_PX + column * width, row * height);
        for (line, text) in lines.iter().enumerate() {
            let at = [left, top + 8 + line * self.line_px].map(|v| v as i64);
            canvas.text(at, text, self.dot_px, INK);
        }
        let labels = scene.truth.iter();
        let unknown = labels.filter(|l| l.kind == ObjectKind::Unknown && with_labels);
        let labels: Vec<&SensorDetection> = unknown.collect();
        let [above_px, eye_px] = self.heights_px.map(|height| [self.width_px, height]);
        let above = Projection::above(scene.target_m, self.px_per_m, above_px);
        let eye = Projection::towards(scene.target_m, eye_px);
        let top = top + self.head_px;
        for (projection, top) in [(above, top), (eye, top + above_px[1] + GAP_PX)] {
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
        width_px: 330,
        heights_px: [300, 210],
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
        width_px: 460,
        heights_px: [380, 260],
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
    use mluc_ipc_types::Point;

    fn scene() -> DrawnScene {
        DrawnScene {
            caption: "sim-udi, frame 3".into(),
            points: vec![Point::default()],
            truth: vec![SensorDetection {
                class: "golf_cart".into(),
                kind: ObjectKind::Unknown,
                score: 1.0,
                box_in_sensor: Box3::new([12.0, 0.0, -1.0, 2.4, 1.3, 1.9, 0.3]),
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
        let count = |from: usize, is_it: fn(Color) -> bool| {
            let pixels = (60..360).flat_map(|y| (from..from + 330).map(move |x| (x, y)));
            let found = pixels.filter(|(x, y)| canvas.pixel(*x, *y).is_some_and(is_it));
            found.count()
        };
        // Red wires in the labels' column, white dashes in the method's: no more than half of a wire.
        let reds = [8, 346].map(|from| count(from, |c| c[0] > 200 && c[1] < 120 && c[2] < 120));
        let whites = [8, 346].map(|from| count(from, |c| c.iter().all(|v| *v > 150)));
        assert!(reds[0] > 50 && reds[1] == 0, "{reds:?}");
        assert!(
            whites[0] == 0 && (10..reds[0]).contains(&whites[1]),
            "{whites:?}"
        );
    }

    #[test]
    fn the_page_of_the_worst_has_three_frames_a_row() {
        let size = |count: usize| worst_page(&vec![scene(); count]).size_px();
        assert_eq!(size(3)[1], size(1)[1]);
        assert_eq!(size(4)[1] - FOOT_PX, 2 * (size(3)[1] - FOOT_PX));
    }
}
