//! Drawing with SVG: axes, text, shapes. No script and nothing from outside, so a page works offline and for ever.

/// By stage: grey, blue, orange, green. Told apart with the usual colour blindnesses, on white and on black.
pub(crate) const STAGE_COLORS: [&str; 4] = ["#7d8590", "#2f7ed8", "#e08a2b", "#1d9e74"];
/// End to end.
pub(crate) const TOTAL_COLOR: &str = "#8250df";
/// Dropped, late.
pub(crate) const ALARM_COLOR: &str = "#d1242f";
/// Waiting.
pub(crate) const QUEUE_COLOR: &str = "#b9c0c9";

pub(crate) struct Svg {
    width: f64,
    height: f64,
    body: String,
}

impl Svg {
    pub(crate) fn new(width: f64, height: f64) -> Svg {
        let body = String::new();
        Svg {
            width,
            height,
            body,
        }
    }

    /// `tip`: shown where the pointer rests.
    fn shape(&mut self, name: &str, attributes: String, tip: &str) {
        self.body += &match tip {
            "" => format!("<{name} {attributes}/>"),
            tip => format!(
                "<{name} {attributes}><title>{}</title></{name}>",
                escape(tip)
            ),
        };
    }

    pub(crate) fn rect(&mut self, [x, y, width, height]: [f64; 4], fill: &str, tip: &str) {
        let (width, height) = (width.max(0.0), height.max(0.0));
        let attributes = format!(
            r#"x="{x:.1}" y="{y:.1}" width="{width:.1}" height="{height:.1}" fill="{fill}""#
        );
        self.shape("rect", attributes, tip);
    }

    pub(crate) fn dot(&mut self, [x, y]: [f64; 2], fill: &str, tip: &str) {
        let attributes = format!(r#"cx="{x:.1}" cy="{y:.1}" r="2.2" fill="{fill}""#);
        self.shape("circle", attributes, tip);
    }

    /// In the colour of an alarm.
    pub(crate) fn cross(&mut self, [x, y]: [f64; 2], tip: &str) {
        let corner = format!("M{:.1} {:.1}", x - 3.0, y - 3.0);
        let attributes = format!(
            r#"d="{corner}l6 6m0 -6l-6 6" stroke="{ALARM_COLOR}" stroke-width="1.4" fill="none""#
        );
        self.shape("path", attributes, tip);
    }

    /// `class`: `grid`, `axis` or `mark` of the page's style.
    pub(crate) fn line(&mut self, [x1, y1]: [f64; 2], [x2, y2]: [f64; 2], class: &str) {
        let attributes =
            format!(r#"class="{class}" x1="{x1:.1}" y1="{y1:.1}" x2="{x2:.1}" y2="{y2:.1}""#);
        self.shape("line", attributes, "");
    }

    pub(crate) fn polyline(&mut self, points: impl Iterator<Item = [f64; 2]>, color: &str) {
        let points: String = points.map(|[x, y]| format!("{x:.1},{y:.1} ")).collect();
        let attributes =
            format!(r#"points="{points}" fill="none" stroke="{color}" stroke-width="1.8""#);
        self.shape("polyline", attributes, "");
    }

    /// `anchor`: `start`, `middle` or `end` of the text stands at its point.
    pub(crate) fn text(&mut self, [x, y]: [f64; 2], anchor: &str, text: &str) {
        let text = escape(text);
        self.body +=
            &format!(r#"<text x="{x:.1}" y="{y:.1}" text-anchor="{anchor}">{text}</text>"#);
    }

    /// Grid from `left` to `right` and numbers of a vertical axis.
    pub(crate) fn vertical_axis(&mut self, scale: &Scale, [left, right]: [f64; 2], unit: &str) {
        for tick in scale.ticks() {
            let y = scale.place(tick);
            self.line([left, y], [right, y], "grid");
            self.text([left - 6.0, y + 4.0], "end", &short(tick));
        }
        self.text([left - 6.0, scale.places[1] - 8.0], "end", unit);
    }

    /// Grid and numbers of a horizontal axis at `bottom`.
    pub(crate) fn horizontal_axis(&mut self, scale: &Scale, [top, bottom]: [f64; 2], unit: &str) {
        for tick in scale.ticks() {
            let x = scale.place(tick);
            self.line([x, top], [x, bottom], "grid");
            self.text([x, bottom + 15.0], "middle", &short(tick));
        }
        self.text([scale.places[1], bottom + 30.0], "end", unit);
    }

    /// Colours and their words, along the upper edge from `x`.
    pub(crate) fn legend<'a>(
        &mut self,
        mut x: f64,
        entries: impl IntoIterator<Item = (&'a str, &'a str)>,
    ) {
        for (color, text) in entries {
            self.rect([x, 4.0, 11.0, 11.0], color, "");
            self.text([x + 16.0, 14.0], "start", text);
            x += 34.0 + 7.0 * text.len() as f64;
        }
    }

    /// `label`: read out to those who do not see it. Colours of text and lines come from the page's style.
    pub(crate) fn finish(self, label: &str) -> String {
        let (width, height, label) = (self.width, self.height, escape(label));
        format!(
            r#"<svg viewBox="0 0 {width:.0} {height:.0}" width="{width:.0}" role="img" aria-label="{label}">{}</svg>"#,
            self.body
        )
    }
}

/// Text for HTML and SVG, attributes too.
pub(crate) fn escape(text: &str) -> String {
    let text = text.replace('&', "&amp;").replace('<', "&lt;");
    let text = text.replace('>', "&gt;").replace('"', "&quot;");
    text.replace('\'', "&#39;")
}

/// From values to places along one direction.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Scale {
    values: [f64; 2],
    places: [f64; 2],
    is_log: bool,
}

impl Scale {
    pub(crate) fn linear([low, high]: [f64; 2], places: [f64; 2]) -> Scale {
        Scale {
            values: [low, if high > low { high } else { low + 1.0 }],
            places,
            is_log: false,
        }
    }

    /// Both values above 0.
    pub(crate) fn log([low, high]: [f64; 2], places: [f64; 2]) -> Scale {
        let low = low.max(1e-9);
        Scale {
            values: [low, high.max(low * 1.001)],
            places,
            is_log: true,
        }
    }

    pub(crate) fn place(&self, value: f64) -> f64 {
        let [low, high] = self.values;
        let share = if self.is_log {
            (value.max(low) / low).ln() / (high / low).ln()
        } else {
            (value - low) / (high - low)
        };
        self.places[0] + share.clamp(0.0, 1.0) * (self.places[1] - self.places[0])
    }

    /// Round values inside, few enough to be read.
    pub(crate) fn ticks(&self) -> Vec<f64> {
        let [low, high] = self.values;
        if !self.is_log {
            // 1, 2 or 5 times a power of ten, at most five of them.
            let least = ((high - low) / 5.0).max(1e-9);
            let power = 10f64.powf(least.log10().floor());
            let mut steps = [1.0, 2.0, 5.0].into_iter().map(|step| step * power);
            let step = steps.find(|step| *step >= least * 0.999);
            let step = step.unwrap_or(10.0 * power);
            let (first, last) = ((low / step).ceil(), (high / step + 1e-9).floor());
            return (first as i64..=last as i64)
                .map(|n| n as f64 * step)
                .collect();
        }
        let is_wide = (high / low).log10() > 2.5;
        let steps = &[1.0, 2.0, 5.0][..if is_wide { 1 } else { 3 }];
        let powers = low.log10().floor() as i32..=high.log10().ceil() as i32;
        let ticks = powers.flat_map(|power| steps.iter().map(move |s| s * 10f64.powi(power)));
        ticks
            .filter(|tick| (low * 0.999..=high * 1.001).contains(tick))
            .collect()
    }
}

/// A number with the digits that matter.
pub(crate) fn short(value: f64) -> String {
    let digits = match value.abs() {
        v if v >= 99.95 => 0,
        v if v >= 9.995 => 1,
        v if v >= 0.995 => 2,
        0.0 => 0,
        _ => 3,
    };
    let text = format!("{value:.digits$}");
    if digits == 0 {
        return text;
    }
    text.trim_end_matches('0').trim_end_matches('.').to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        let scale = Scale::linear([0.0, 47.0], [0.0, 100.0]);
        assert_eq!(scale.ticks(), [0.0, 10.0, 20.0, 30.0, 40.0]);
        let scale = Scale::log([0.03, 900.0], [0.0, 100.0]);
        assert_eq!(scale.ticks().len(), 4);
        let scale = Scale::log([10.0, 100.0], [0.0, 100.0]);
        assert_eq!(scale.ticks(), [10.0, 20.0, 50.0, 100.0]);
        assert_eq!(Scale::linear([3.0, 3.0], [0.0, 1.0]).place(9.0), 1.0);
    }

    #[test]
    fn numbers_are_short_and_text_cannot_leave_its_place() {
        let texts = [0.0, 0.0123, 1.5, 2.0, 12.34, 99.97, 1234.5].map(short);
        assert_eq!(texts, ["0", "0.012", "1.5", "2", "12.3", "100", "1234"]);
        let escaped = "&lt;a href=&quot;x&quot;&gt;&#39;&amp;";
        assert_eq!(escape("<a href=\"x\">'&"), escaped);
    }
}
