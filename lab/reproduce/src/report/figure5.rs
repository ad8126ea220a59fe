//! The paper's figure 5: AP of the unknown and mAP of the known over the recall of the unknown, one curve per method, one column
//! per setting. The points keep nine tenths of the closed set's mAP; a ring marks the chosen point.

use super::data::{ReproductionReport, Rows, present};
use crate::methods::METHODS;
use mluc_evaluate::SweepPoint;
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

const PANEL_PX: (u32, u32) = (500, 320);
const LEGEND_PX: u32 = 240;
const FONT: &str = "sans-serif";

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Drawn = Result<(), DrawingAreaErrorKind<std::io::Error>>;

/// A panel: its name, its figure, and the function from a point to that figure.
type Shown = (&'static str, &'static str, fn(&SweepPoint) -> f64);

/// The figure as SVG; the error is a message.
pub(crate) fn svg(report: &ReproductionReport) -> Result<String, String> {
    let columns = report.settings.len().max(1);
    let size_px = (columns as u32 * PANEL_PX.0 + LEGEND_PX, 2 * PANEL_PX.1);
    let mut text = String::new();
    let backend = SVGBackend::with_string(&mut text, size_px);
    draw(backend, report, columns).map_err(|e| e.to_string())?;
    Ok(text)
}

fn draw(backend: SVGBackend, report: &ReproductionReport, columns: usize) -> Drawn {
    let root = backend.into_drawing_area();
    root.fill(&WHITE)?;
    let (panels, legend) = root.split_horizontally(columns as u32 * PANEL_PX.0);
    let shown: [Shown; 2] = [
        ("AP of the unknown, %", "ap_unknown", |p| p.ap_unknown),
        ("mAP of the known, %", "map_known", |p| p.map_known),
    ];
    // The order of the paper: industrial park first.
    let settings: Vec<_> = report.settings.iter().rev().collect();
    for (at, area) in panels.split_evenly((2, columns)).iter().enumerate() {
        if let Some((setting, rows)) = settings.get(at % columns) {
            draw_panel(area, setting, rows, shown[at / columns])?;
        }
    }
    draw_legend(&legend, report)?;
    root.present()
}

fn draw_panel(area: &Area, setting: &str, rows: &Rows, (name, figure, of): Shown) -> Drawn {
    let curves = rows.values().flat_map(|row| &row.curve).map(of);
    let chosen = rows.values().filter_map(|row| row.mean(figure));
    // Round axis ends. Curves that keep nine tenths of the known are close together, so that axis starts below the lowest point.
    let (low, high) = if figure == "map_known" {
        let least = curves.fold(100.0, f64::min) - 4.0;
        ((10.0 * (least / 10.0).floor()).max(0.0), 100.0)
    } else {
        let most = curves.chain(chosen).fold(5.0, f64::max);
        (0.0, (10.0 * (most / 10.0).ceil()).min(100.0))
    };
    let mut chart = ChartBuilder::on(area)
        .caption(format!("{setting}: {name}"), (FONT, 15))
        .margin(14)
        .x_label_area_size(36)
        .y_label_area_size(36)
        .build_cartesian_2d(0.0..100.0, low..high)?;
    let mut mesh = chart.configure_mesh();
    mesh.x_desc("recall of the unknown, %").x_labels(6);
    mesh.y_labels(6).label_style((FONT, 12));
    mesh.light_line_style(TRANSPARENT).draw()?;
    for (method, figures) in present(rows) {
        let [r, g, b] = method.color;
        let color = RGBColor(r, g, b);
        let curve = figures.curve.iter();
        let mut points: Vec<(f64, f64)> = curve.map(|p| (p.recall_unknown, of(p))).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        chart.draw_series(LineSeries::new(points, color.stroke_width(2)))?;
        if let (Some(x), Some(y)) = (figures.mean("recall_unknown"), figures.mean(figure)) {
            let at = (x, y.clamp(low, high));
            let ring = [(5, color), (2, WHITE)];
            let ring = ring.map(|(r, color)| Circle::new(at, r, color.filled()));
            chart.draw_series(ring)?;
        }
    }
    Ok(())
}

fn draw_legend(area: &Area, report: &ReproductionReport) -> Drawn {
    let is_shown = |key: &String| report.settings.values().any(|rows| rows.contains_key(key));
    let style = (FONT, 12).into_font().into_text_style(area);
    let style = style.pos(Pos::new(HPos::Left, VPos::Center));
    let mut y = 60;
    for method in METHODS.iter().filter(|method| is_shown(&method.key)) {
        let [r, g, b] = method.color;
        let style_of_line = RGBColor(r, g, b).stroke_width(3);
        let line = vec![(10, y), (32, y)];
        area.draw(&PathElement::new(line, style_of_line))?;
        area.draw(&Text::new(method.title.as_str(), (40, y), &style))?;
        y += 22;
    }
    for (radius, color) in [(5, BLACK), (2, WHITE)] {
        area.draw(&Circle::new((21, y), radius, color.filled()))?;
    }
    area.draw(&Text::new("chosen", (40, y), &style))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::MethodFigures;

    #[test]
    fn it_shows_a_curve_in_its_colour() {
        let point = |recall: f64| SweepPoint {
            threshold: recall / 100.0,
            recall_unknown: recall,
            ap_unknown: recall / 2.0,
            map_known: 80.0 - recall / 10.0,
        };
        let figures = ["recall_unknown", "ap_unknown", "map_known"];
        let row = MethodFigures {
            curve: [60.0, 0.0, 20.0, 40.0].map(point).to_vec(),
            figures: figures.map(|name| (name.to_owned(), [40.0, 0.0])).into(),
            ..MethodFigures::default()
        };
        let report = ReproductionReport {
            settings: [("sim-udi".to_owned(), [("mluc-full".to_owned(), row)].into())].into(),
            ..ReproductionReport::default()
        };
        let text = svg(&report).expect("a picture");
        let curves: Vec<&str> = text.lines().filter(|l| l.contains("#D52828")).collect();
        let lines: Vec<&&str> = curves.iter().filter(|l| l.contains("<polyline")).collect();
        // Two panels and the legend, with one ring per panel.
        assert_eq!((lines.len(), curves.len()), (3, 5), "{text}");
        let corners = lines[0].split('"').find(|part| part.contains(','));
        let corner = |text: &str| -> Option<[f64; 2]> {
            let (x, y) = text.split_once(',')?;
            Some([x.parse().ok()?, y.parse().ok()?])
        };
        let corners = corners.expect("points").split_whitespace();
        let corners: Vec<[f64; 2]> = corners.map(|c| corner(c).expect("x, y")).collect();
        let rises = |a: &[f64; 2], b: &[f64; 2]| a[0] < b[0] && a[1] > b[1];
        assert!(corners.len() == 4 && corners.is_sorted_by(rises), "{text}");
        assert!(text.contains("MLUC full (ours)"));
        // An empty report gives a picture without curves, not an error.
        svg(&ReproductionReport::default()).expect("a picture");
    }
}
