//! A chart as an SVG file: a few lines, both axes linear from 0.

use anyhow::Result;
use plotters::prelude::*;

const SIZE_PX: (u32, u32) = (760, 440);
const FONT: &str = "sans-serif";
/// Told apart by people who do not see red and green alike (Okabe and Ito).
const COLORS: [RGBColor; 4] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
];

/// One line: its name in the legend, and x and y in their order.
pub(crate) type Line = (String, Vec<(f64, f64)>);

/// The file's text; the labels of the axes with their units.
pub(crate) fn svg(title: &str, [x_label, y_label]: [&str; 2], lines: &[Line]) -> Result<String> {
    let points = || lines.iter().flat_map(|(_, points)| points);
    let x_max = points().map(|point| point.0).fold(0.0, f64::max);
    let y_max = points().map(|point| point.1).fold(0.0, f64::max);
    let mut text = String::new();
    let root = SVGBackend::with_string(&mut text, SIZE_PX).into_drawing_area();
    root.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&root)
        .caption(title, (FONT, 16))
        .margin(14)
        .x_label_area_size(40)
        .y_label_area_size(56)
        .build_cartesian_2d(0.0..x_max, 0.0..y_max)?;
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .label_style((FONT, 12))
        .x_desc(x_label)
        .y_desc(y_label)
        .draw()?;
    for ((name, points), color) in lines.iter().zip(COLORS.into_iter().cycle()) {
        let line = LineSeries::new(points.iter().copied(), color.stroke_width(2)).point_size(3);
        chart
            .draw_series(line)?
            .label(name)
            .legend(move |(x, y)| Circle::new((x + 8, y), 4, color.filled()));
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperLeft)
        .label_font((FONT, 12))
        .draw()?;
    root.present()?;
    drop(chart);
    drop(root);
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_given_is_drawn() {
        let line = |name: &str, points: &[(f64, f64)]| (name.to_owned(), points.to_vec());
        let lines = [
            line("one", &[(0.0, 0.0), (100.0, 8.0)]),
            line("two", &[(50.0, 10.0)]),
        ];
        let svg = svg("a < b", ["points", "ms"], &lines).unwrap();
        assert!(svg.starts_with("<svg") && svg.contains("a &lt; b"));
        assert!(svg.contains("\npoints\n") && svg.contains("\nms\n"));
        // A circle each, and one in the legend.
        assert_eq!(svg.matches("<circle").count(), 3 + 2);
    }
}
