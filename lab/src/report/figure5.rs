//! The paper's figure 5: AP of the unknown and mAP of the known over the recall of the unknown, one curve a method, one column a
//! setting. Points are those that keep nine tenths of the closed set's mAP; a ring marks the chosen one.

use super::axes::{Axes, end_of};
use super::data::{CurvePoint, MethodFigures, Report};
use super::drawing::{Anchor, Drawing, Shape};
use super::tables::present;
use mluc_gateway::picture::Color;

const PANEL_PX: [f32; 2] = [420.0, 250.0];
const MARGIN_PX: [f32; 2] = [64.0, 84.0];
const GAP_PX: [f32; 2] = [76.0, 78.0];
const LEGEND_PX: f32 = 236.0;
const INK: Color = [40, 40, 40];

/// Draws every setting of a report that has curves.
pub fn figure5(report: &Report) -> Drawing {
    // The paper's order: the industrial park first.
    let settings: Vec<_> = report.settings.iter().rev().collect();
    let columns = settings.len().max(1) as f32;
    let width = MARGIN_PX[0] + columns * PANEL_PX[0] + (columns - 1.0) * GAP_PX[0] + LEGEND_PX;
    let height = MARGIN_PX[1] + 2.0 * PANEL_PX[1] + GAP_PX[1] + 50.0;
    let mut drawing = Drawing::new(width, height);
    for (column, (setting, rows)) in settings.iter().enumerate() {
        let left = MARGIN_PX[0] + column as f32 * (PANEL_PX[0] + GAP_PX[0]);
        let title = [left + PANEL_PX[0] / 2.0, 28.0];
        drawing.text(title, setting, 14.0, INK, Anchor::Middle);
        let best = |of: fn(&CurvePoint) -> f64| {
            let points = rows.values().flat_map(|row| &row.curve);
            points.map(of).fold(0.0, f64::max)
        };
        let supervised = rows.get("supervised").and_then(|row| row.get("ap_unknown"));
        let unknown_max = best(|p| p.ap_unknown).max(supervised.map_or(0.0, |v| v[0]));
        let known_min = {
            let points = rows.values().flat_map(|row| &row.curve);
            points.map(|p| p.map_known).fold(100.0, f64::min)
        };
        // Round, and with room below the lowest curve; curves that keep nine tenths lie close together.
        let known_min = (((known_min - 4.0) / 10.0).floor() * 10.0).max(0.0);
        let panels = [
            (
                "AP of the unknown, %",
                [0.0, end_of(unknown_max, 5.0)],
                "ap_unknown",
            ),
            ("mAP of the known, %", [known_min, 100.0], "map_known"),
        ];
        for (row, (name, [y_min, y_max], figure)) in panels.into_iter().enumerate() {
            let top = MARGIN_PX[1] + row as f32 * (PANEL_PX[1] + GAP_PX[1]);
            let axes = Axes {
                low: [left, top],
                high: [left + PANEL_PX[0], top + PANEL_PX[1]],
                x_max: 100.0,
                y_min,
                y_max,
            };
            axes.draw(&mut drawing, "recall of the unknown, %", name);
            for (method, figures) in present(rows) {
                draw_method(&mut drawing, &axes, figures, method.color, figure);
            }
        }
    }
    legend(&mut drawing, report, width - LEGEND_PX + 24.0);
    drawing
}

fn draw_method(
    drawing: &mut Drawing,
    axes: &Axes,
    figures: &MethodFigures,
    color: Color,
    figure: &str,
) {
    let value = |point: &CurvePoint| match figure {
        "ap_unknown" => point.ap_unknown,
        _ => point.map_known,
    };
    let mut points: Vec<&CurvePoint> = figures.curve.iter().collect();
    points.sort_by(|a, b| a.recall_unknown.total_cmp(&b.recall_unknown));
    let corners: Vec<[f32; 2]> = points
        .iter()
        .map(|point| axes.at(point.recall_unknown, value(point)))
        .collect();
    if corners.len() > 1 {
        drawing.path(&corners, 2.2, color);
    }
    let (Some([recall, _]), Some([y, _])) = (figures.get("recall_unknown"), figures.get(figure))
    else {
        return;
    };
    let at = axes.at(recall, y);
    drawing.dot(at, 5.0, color);
    drawing.dot(at, 2.4, [255, 255, 255]);
}

fn legend(drawing: &mut Drawing, report: &Report, left: f32) {
    let methods = super::METHODS.iter().filter(|method| {
        let mut rows = report.settings.values();
        rows.any(|rows| rows.contains_key(method.key))
    });
    let mut y = MARGIN_PX[1] + 8.0;
    for method in methods {
        drawing.path(&[[left, y], [left + 22.0, y]], 3.0, method.color);
        drawing.text([left + 30.0, y], method.title, 8.0, INK, Anchor::Start);
        y += 22.0;
    }
    drawing.dot([left + 11.0, y + 6.0], 5.0, INK);
    drawing.dot([left + 11.0, y + 6.0], 2.4, [255, 255, 255]);
    drawing.text([left + 30.0, y + 6.0], "chosen", 8.0, INK, Anchor::Start);
    drawing.shapes.push(Shape::Path {
        points: vec![[left - 14.0, MARGIN_PX[1] - 6.0], [left - 14.0, y + 20.0]],
        width_px: 1.0,
        color: [200, 200, 200],
        dashed: false,
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report() -> Report {
        let point = |recall: f64| CurvePoint {
            threshold: recall / 100.0,
            recall_unknown: recall,
            ap_unknown: recall / 2.0,
            map_known: 80.0 - recall / 10.0,
        };
        let row = MethodFigures {
            curve: [0.0, 20.0, 40.0, 60.0].map(point).to_vec(),
            figures: [
                ("recall_unknown", 40.0),
                ("ap_unknown", 20.0),
                ("map_known", 76.0),
            ]
            .map(|(name, v)| (name.to_owned(), [v, 0.0]))
            .into(),
            ..MethodFigures::default()
        };
        Report {
            settings: [("sim-udi".to_owned(), [("improved".to_owned(), row)].into())].into(),
            ..Report::default()
        }
    }

    #[test]
    fn a_curve_rises_from_left_to_right_in_its_colour() {
        let drawing = figure5(&report());
        let curves: Vec<_> = drawing
            .shapes
            .iter()
            .filter_map(|shape| match shape {
                Shape::Path { points, color, .. } if points.len() == 4 => Some((points, color)),
                _ => None,
            })
            .collect();
        assert_eq!(curves.len(), 2);
        let (unknown, color) = curves[0];
        assert_eq!(
            *color,
            super::super::method_row("improved").expect("a row").color
        );
        assert!(
            unknown
                .windows(2)
                .all(|w| w[1][0] > w[0][0] && w[1][1] < w[0][1])
        );
        assert!(drawing.to_svg().contains("Improved (ours)"));
        // An empty report is a picture without curves, not a fault.
        figure5(&Report::default()).to_canvas(1.0);
    }
}
