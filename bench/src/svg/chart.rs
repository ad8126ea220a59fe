//! A chart as a file of its own: a few series, both axes linear from 0.

use super::{Anchor, Scale, Svg, horizontal_axis, vertical_axis};

const WIDTH: f64 = 760.0;
const HEIGHT: f64 = 440.0;
/// Left, top, right, bottom of the plot.
const MARGINS: [f64; 4] = [70.0, 60.0, 170.0, 56.0];
/// Told apart by people who do not see red and green alike (Okabe and Ito).
const COLORS: [&str; 6] = [
    "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9",
];

/// One line of a chart.
pub struct Series {
    /// In the legend.
    pub name: String,
    /// x and y, joined in their order.
    pub points: Vec<[f64; 2]>,
}

/// A chart.
pub struct Chart {
    /// Above.
    pub title: String,
    /// With its unit.
    pub x_label: String,
    /// With its unit.
    pub y_label: String,
    /// In the order of the legend.
    pub series: Vec<Series>,
}

impl Chart {
    /// The picture, an SVG file's text.
    pub fn svg(&self) -> String {
        let [left, top, right, bottom] = MARGINS;
        let (right, bottom) = (WIDTH - right, HEIGHT - bottom);
        let x = Scale::linear([0.0, self.largest(0)], [left, right]);
        let y = Scale::linear([0.0, self.largest(1)], [bottom, top]);
        let mut svg = Svg::new(WIDTH, HEIGHT);
        svg.text([left, 20.0], Anchor::Start, &self.title);
        svg.text([left, top - 14.0], Anchor::Start, &self.y_label);
        vertical_axis(&mut svg, &y, left, right, "");
        horizontal_axis(&mut svg, &x, top, bottom, &self.x_label);
        for (number, series) in self.series.iter().enumerate() {
            let color = COLORS[number % COLORS.len()];
            let points = series
                .points
                .iter()
                .map(|at| [x.place(at[0]), y.place(at[1])]);
            let points: Vec<[f64; 2]> = points.collect();
            svg.polyline(&points, color);
            for &point in &points {
                svg.dot(point, 3.5, color, "");
            }
            let legend_y = top + 18.0 * number as f64 + 10.0;
            svg.dot([right + 14.0, legend_y - 4.0], 3.5, color, "");
            svg.text([right + 24.0, legend_y], Anchor::Start, &series.name);
        }
        svg.finish_file()
    }

    fn largest(&self, axis: usize) -> f64 {
        let values = self.series.iter().flat_map(|series| &series.points);
        let finite = values.map(|point| point[axis]).filter(|v| v.is_finite());
        finite.fold(0.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_given_is_drawn() {
        let series = |name: &str, points: &[[f64; 2]]| Series {
            name: name.into(),
            points: points.to_vec(),
        };
        let chart = Chart {
            title: "a < b".into(),
            x_label: "points".into(),
            y_label: "ms".into(),
            series: vec![
                series("line", &[[0.0, 0.0], [100.0, 8.0]]),
                series("dot", &[[50.0, 10.0]]),
            ],
        };
        let svg = chart.svg();
        assert!(svg.starts_with("<svg") && svg.ends_with("</svg>\n"));
        assert!(svg.contains("a &lt; b"));
        assert_eq!(svg.matches("<polyline").count(), 2);
        assert_eq!(svg.matches("<circle").count(), 3 + 2);
        // The largest x lies on the right edge of the plot, the largest y on its upper edge.
        assert!(svg.contains("cx=\"590.0\""), "{svg}");
        assert!(svg.contains("cy=\"60.0\""), "{svg}");
    }
}
