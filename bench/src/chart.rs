//! A small chart as SVG text: a few series over one axis, both axes linear from 0.

use std::fmt::Write;

const WIDTH: f64 = 760.0;
const HEIGHT: f64 = 440.0;
/// Left, top, right, bottom of the plot.
const MARGINS: [f64; 4] = [70.0, 44.0, 170.0, 56.0];
/// Told apart by people who do not see red and green alike (Okabe and Ito).
const COLOURS: [&str; 6] = [
    "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9",
];

/// One line of a chart.
pub struct Series {
    /// In the legend.
    pub name: String,
    /// x and y.
    pub points: Vec<[f64; 2]>,
    /// Joined in their order, or dots alone.
    pub is_line: bool,
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
    /// The picture.
    pub fn svg(&self) -> String {
        let [left, top, right, bottom] = MARGINS;
        let [x_step, y_step] = [0, 1].map(|axis| step_for(self.largest(axis)));
        let [x_max, y_max] = [(x_step, 0), (y_step, 1)]
            .map(|(step, axis)| (self.largest(axis) / step).ceil().max(1.0) * step);
        let x_at = |x: f64| left + x / x_max * (WIDTH - left - right);
        let y_at = |y: f64| HEIGHT - bottom - y / y_max * (HEIGHT - top - bottom);
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" font-family=\"sans-serif\" \
             font-size=\"12\">\n<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n\
             <text x=\"{left}\" y=\"24\" font-size=\"15\">{}</text>\n",
            escaped(&self.title)
        );
        for tick in 0..=(x_max / x_step).round() as usize {
            let (x, value) = (x_at(tick as f64 * x_step), tick as f64 * x_step);
            let y = HEIGHT - bottom;
            line(&mut svg, [x, top, x, y], "#dddddd");
            text(&mut svg, [x, y + 18.0], "middle", &short(value));
        }
        for tick in 0..=(y_max / y_step).round() as usize {
            let (y, value) = (y_at(tick as f64 * y_step), tick as f64 * y_step);
            line(&mut svg, [left, y, WIDTH - right, y], "#dddddd");
            text(&mut svg, [left - 8.0, y + 4.0], "end", &short(value));
        }
        let middle = (left + WIDTH - right) / 2.0;
        text(&mut svg, [middle, HEIGHT - 14.0], "middle", &self.x_label);
        let middle = (top + HEIGHT - bottom) / 2.0;
        let _ = writeln!(
            svg,
            "<text transform=\"translate(18 {middle:.1}) rotate(-90)\" text-anchor=\"middle\">{}</text>",
            escaped(&self.y_label)
        );
        for (number, series) in self.series.iter().enumerate() {
            let colour = COLOURS[number % COLOURS.len()];
            let at = |[x, y]: [f64; 2]| [x_at(x), y_at(y)];
            draw(&mut svg, series, colour, at);
            let y = top + 18.0 * number as f64 + 10.0;
            let x = WIDTH - right + 14.0;
            dot(&mut svg, [x, y - 4.0], colour);
            text(&mut svg, [x + 10.0, y], "start", &series.name);
        }
        svg.push_str("</svg>\n");
        svg
    }

    fn largest(&self, axis: usize) -> f64 {
        let values = self.series.iter().flat_map(|series| &series.points);
        values
            .map(|point| point[axis])
            .filter(|value| value.is_finite())
            .fold(0.0, f64::max)
    }
}

/// 1, 2 or 5 times a power of ten: at most 10 steps up to `largest`.
fn step_for(largest: f64) -> f64 {
    if largest <= 0.0 {
        return 1.0;
    }
    let power = 10_f64.powf((largest / 10.0).log10().floor());
    let steps = [1.0, 2.0, 5.0, 10.0].map(|factor| factor * power);
    let enough = steps.into_iter().find(|step| largest / step <= 10.0 + 1e-9);
    enough.unwrap_or(10.0 * power)
}

fn draw(svg: &mut String, series: &Series, colour: &str, at: impl Fn([f64; 2]) -> [f64; 2]) {
    if series.is_line {
        let corners: String = series
            .points
            .iter()
            .map(|point| {
                let [x, y] = at(*point);
                format!("{x:.1},{y:.1} ")
            })
            .collect();
        let _ = writeln!(
            svg,
            "<polyline fill=\"none\" stroke=\"{colour}\" stroke-width=\"2\" points=\"{}\"/>",
            corners.trim_end()
        );
    }
    for point in &series.points {
        dot(svg, at(*point), colour);
    }
}

fn dot(svg: &mut String, [x, y]: [f64; 2], colour: &str) {
    let _ = writeln!(
        svg,
        "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3.5\" fill=\"{colour}\"/>"
    );
}

fn line(svg: &mut String, [x1, y1, x2, y2]: [f64; 4], colour: &str) {
    let _ = writeln!(
        svg,
        "<line x1=\"{x1:.1}\" y1=\"{y1:.1}\" x2=\"{x2:.1}\" y2=\"{y2:.1}\" stroke=\"{colour}\"/>"
    );
}

fn text(svg: &mut String, [x, y]: [f64; 2], anchor: &str, text: &str) {
    let _ = writeln!(
        svg,
        "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\">{}</text>",
        escaped(text)
    );
}

/// 20000 as 20k, and no more digits than needed.
fn short(value: f64) -> String {
    match value {
        value if value >= 10_000.0 => format!("{}k", (value / 100.0).round() / 10.0),
        value => format!("{}", (value * 1000.0).round() / 1000.0),
    }
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_round_and_few() {
        for (largest, step) in [
            (0.0, 1.0),
            (7.0, 1.0),
            (10.0, 1.0),
            (11.0, 2.0),
            (45.0, 5.0),
        ] {
            assert_eq!(step_for(largest), step, "{largest}");
        }
        assert_eq!(short(20_000.0), "20k");
        assert_eq!(short(0.30000000000000004), "0.3");
    }

    #[test]
    fn what_is_given_is_drawn() {
        let chart = Chart {
            title: "a < b".into(),
            x_label: "points".into(),
            y_label: "ms".into(),
            series: vec![
                Series {
                    name: "line".into(),
                    points: vec![[0.0, 0.0], [100.0, 8.0]],
                    is_line: true,
                },
                Series {
                    name: "dots".into(),
                    points: vec![[50.0, 10.0]],
                    is_line: false,
                },
            ],
        };
        let svg = chart.svg();
        assert!(svg.starts_with("<svg") && svg.ends_with("</svg>\n"));
        assert!(svg.contains("a &lt; b"));
        assert_eq!(svg.matches("<polyline").count(), 1);
        assert_eq!(svg.matches("<circle").count(), 3 + 2);
        // The largest x lies on the right edge of the plot, the largest y on its upper edge.
        assert!(svg.contains("cx=\"590.0\""), "{svg}");
        assert!(svg.contains("cy=\"44.0\""), "{svg}");
    }
}
