//! Scenes from above: the paper's figure 6 (one scene with its labels and with the objects of each method, side by side).

use mluc_evaluate::{ObjectKind, SensorDetection};
use mluc_gateway::picture::{BoxKind, Canvas, Color, DrawnBox, View, bird_eye};
use mluc_ipc_types::Point;

const PAPER: Color = [250, 250, 250];
const INK: Color = [30, 30, 30];
const GAP_PX: usize = 8;
/// Height of two lines of text over a picture.
const HEAD_PX: usize = 36;
const LINE_PX: usize = 14;
/// Side length of a picture, m, and its pixels per metre.
const SIDE_M: f32 = 48.0;
const PX_PER_M: f32 = 9.0;

/// A title, and the objects found.
pub(crate) type Panel = (String, Vec<SensorDetection>);

/// A scan, its labels, and the objects found.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct DrawnScene {
    /// Information for the reader: data set, frame, errors.
    pub(crate) caption: String,
    pub(crate) points: Vec<Point>,
    pub(crate) truth: Vec<SensorDetection>,
    /// One panel per method.
    pub(crate) panels: Vec<Panel>,
    /// Centre of the picture: x, y, m.
    pub(crate) target_m: [f64; 2],
}

/// A picture and the text over it.
type Cell = (String, Canvas);

impl DrawnScene {
    /// Draws the found objects over the labels of unknown objects, which have thin lines.
    fn found(&self, text: &str, boxes: &[SensorDetection]) -> Cell {
        let mut labels = self.truth.clone();
        labels.retain(|label| label.kind == ObjectKind::Unknown);
        self.cell(text, boxes, &labels)
    }

    fn cell(&self, text: &str, boxes: &[SensorDetection], labels: &[SensorDetection]) -> Cell {
        let around = |at_m: f64| [-0.5, 0.5].map(|side| at_m as f32 + side * SIDE_M);
        let [x_m, y_m] = self.target_m.map(around);
        let view = View { x_m, y_m, px_per_m: PX_PER_M, ..View::around() };
        let drawn = |kind: fn(ObjectKind) -> BoxKind| {
            move |object: &SensorDetection| DrawnBox {
                box_in_sensor: object.box_in_sensor,
                kind: kind(object.kind),
                label: object.class.clone(),
                caption: String::new(),
            }
        };
        let labels = labels.iter().map(drawn(|_| BoxKind::Truth));
        let of_kind = |kind| [BoxKind::Known, BoxKind::Unknown][kind as usize];
        let boxes = boxes.iter().map(drawn(of_kind));
        let drawn: Vec<DrawnBox> = labels.chain(boxes).collect();
        let picture = bird_eye(bytemuck::cast_slice(&self.points), &drawn, &view);
        (text.to_owned(), picture)
    }
}

/// Pictures of one size in rows.
fn page(rows: &[Vec<Cell>]) -> Canvas {
    let side_px = (SIDE_M * PX_PER_M) as usize;
    let [width, height] = [side_px + GAP_PX, HEAD_PX + side_px];
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let [across, down] = [columns * width, rows.len() * height].map(|px| px + GAP_PX);
    let mut canvas = Canvas::new(across, down, PAPER);
    for (row, cells) in rows.iter().enumerate() {
        for (column, (text, picture)) in cells.iter().enumerate() {
            let (left, top) = (GAP_PX + column * width, row * height);
            for (line, text) in text.lines().enumerate() {
                let at = [left, top + GAP_PX + line * LINE_PX].map(|v| v as i64);
                canvas.text(at, text, 1, INK);
            }
            canvas.paste(picture, [left, top + HEAD_PX]);
        }
    }
    canvas
}

/// Draws scenes one below another: labels first, then one column per panel.
pub(crate) fn figure6(scenes: &[DrawnScene]) -> Canvas {
    let row = |scene: &DrawnScene| {
        let panels = scene.panels.iter().map(|(title, boxes)| scene.found(title, boxes));
        let labels = scene.cell(&format!("{}\nLabels", scene.caption), &scene.truth, &[]);
        [labels].into_iter().chain(panels).collect()
    };
    page(&scenes.iter().map(row).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::*;
    use mluc_geometry::Box3;

    fn scene() -> DrawnScene {
        DrawnScene {
            caption: "sim-udi, frame 3".into(),
            points: vec![Point::default()],
            truth: vec![SensorDetection {
                class: "golf_cart".into(),
                ..SensorDetection::unknown(1.0, Box3::new([12.0, 0.0, -1.0, 2.4, 1.3, 1.9, 0.3]))
            }],
            panels: vec![("MLUC".into(), Vec::new())],
            target_m: [12.0, 0.0],
        }
    }

    #[test]
    fn figure_6_shows_the_labels_and_a_column_a_panel() {
        let canvas = figure6(&[scene(), scene()]);
        assert_eq!(canvas.size_px(), [2 * 440 + 8, 2 * 468 + 8]);
        // Around the target: the labelled unknown object, red; where a method missed it, its label with thin lines in the colour of its class.
        let count = |left: usize, is_it: fn(Color) -> bool| {
            let pixels = (220..280).flat_map(|y| (left + 180..left + 250).map(move |x| (x, y)));
            pixels.filter(|(x, y)| canvas.pixel(*x, *y).is_some_and(is_it)).count()
        };
        let reds = [8, 448].map(|left| count(left, |c| c[0] > 200 && c[1] < 110 && c[2] < 110));
        let pinks = [8, 448].map(|left| count(left, |c| c[0] > 200 && c[2] > 150));
        assert!(reds[0] > 50 && reds[1] == 0, "{reds:?}");
        assert!(pinks[0] == 0 && pinks[1] > 20, "{pinks:?}");
    }
}
