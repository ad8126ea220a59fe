//! How the times of the stages are distributed: histograms, and percentiles up to 99.9.

use mluc_geometry::quantile;

use super::frame::STAGES;
use super::series::Series;
use super::statistics::sorted;
use super::timeline::draw_legend;
use crate::svg::{
    Anchor, QUEUE_COLOR, STAGE_COLORS, Scale, Svg, TOTAL_COLOR, short, vertical_axis,
};

/// Bars of a histogram.
const BARS: usize = 36;

/// Two small histograms a stage: queue above, run below; logarithmic in time, each with its own range.
pub(crate) fn histograms(series: &Series) -> String {
    let mut svg = Svg::new(980.0, 330.0);
    for (stage, name) in STAGES.iter().enumerate() {
        let left = 20.0 + 242.0 * stage as f64;
        svg.text([left, 14.0], Anchor::Start, name);
        histogram(
            &mut svg,
            [left, 38.0],
            "queue",
            QUEUE_COLOR,
            &series.queue_us[stage],
        );
        histogram(
            &mut svg,
            [left, 196.0],
            "run",
            STAGE_COLORS[stage],
            &series.run_us[stage],
        );
    }
    svg.finish("histograms of queueing and computing, by stage")
}

fn histogram(svg: &mut Svg, [left, top]: [f64; 2], what: &str, color: &str, values_us: &[f64]) {
    let (width, height) = (216.0, 84.0);
    let ascending = sorted(values_us);
    let (Some(&low), Some(&high)) = (ascending.first(), ascending.last()) else {
        svg.text(
            [left, top + 40.0],
            Anchor::Start,
            &format!("{what}: no frames"),
        );
        return;
    };
    let (low_ms, high_ms) = (low.max(1.0) / 1000.0 * 0.95, high.max(1.1) / 1000.0 * 1.05);
    let x = Scale::log([low_ms, high_ms], [left, left + width]);
    let mut counts = [0usize; BARS];
    for us in &ascending {
        let share = (x.place(us / 1000.0) - left) / width;
        counts[((share * BARS as f64) as usize).min(BARS - 1)] += 1;
    }
    let most = counts.iter().copied().max().unwrap_or(1).max(1) as f64;
    let bar = width / BARS as f64;
    for (index, &count) in counts.iter().enumerate().filter(|(_, count)| **count > 0) {
        let tall = (count as f64 / most * height).max(1.5);
        let at = [
            left + bar * index as f64,
            top + height - tall,
            bar - 1.0,
            tall,
        ];
        svg.rect(at, color, &format!("{count} frames"));
    }
    let bottom = top + height;
    svg.line([left, bottom], [left + width, bottom], "axis");
    for tick in [low_ms, high_ms] {
        let anchor = if tick == low_ms {
            Anchor::Start
        } else {
            Anchor::End
        };
        svg.text(
            [x.place(tick), bottom + 15.0],
            anchor,
            &format!("{} ms", short(tick)),
        );
    }
    for (word, q) in [("p50", 0.5), ("p99", 0.99)] {
        if let Some(us) = quantile(&ascending, q) {
            let at = x.place(us / 1000.0);
            svg.line([at, top - 2.0], [at, bottom], "mark");
            svg.text([at, top - 5.0], Anchor::Middle, word);
        }
    }
    svg.text([left + width / 2.0, bottom + 28.0], Anchor::Middle, what);
}

/// Percentile curves: to the right the rarer frames, each step ten times as rare.
pub(crate) fn percentile_curves(series: &Series) -> String {
    let (left, right, top, bottom) = (62.0, 960.0, 26.0, 290.0);
    let mut svg = Svg::new(980.0, 330.0);
    let mut lines: Vec<(&str, &str, Vec<f64>)> =
        vec![(TOTAL_COLOR, "end to end", sorted(&series.latency_us))];
    for (stage, name) in STAGES.iter().enumerate() {
        lines.push((STAGE_COLORS[stage], name, sorted(&series.run_us[stage])));
    }
    let all = || {
        lines
            .iter()
            .flat_map(|(_, _, values)| values.iter().copied())
    };
    let low = all().fold(f64::INFINITY, f64::min);
    let high = all().fold(0.0, f64::max);
    if !low.is_finite() || high <= 0.0 {
        return String::new();
    }
    let y = Scale::log(
        [low.max(1.0) / 1000.0 * 0.8, high / 1000.0 * 1.1],
        [bottom, top],
    );
    // Three decades: 0, 90, 99, 99.9 %.
    let x = Scale::linear([0.0, 3.0], [left, right]);
    vertical_axis(&mut svg, &y, left, right, "ms");
    for (share, text) in [
        (0.0, "0 %"),
        (0.5, "50 %"),
        (0.9, "90 %"),
        (0.99, "99 %"),
        (0.999, "99.9 %"),
    ] {
        let at = x.place(decades(share));
        svg.line([at, top], [at, bottom], "grid");
        svg.text([at, bottom + 15.0], Anchor::Middle, text);
    }
    svg.text(
        [right, bottom + 30.0],
        Anchor::End,
        "share of frames that are at most so late",
    );
    for (color, _, values) in &lines {
        let points: Vec<[f64; 2]> = (0..=150)
            .filter_map(|step| {
                let decade = f64::from(step) / 50.0;
                let us = quantile(values, 1.0 - 10f64.powf(-decade))?;
                Some([x.place(decade), y.place(us / 1000.0)])
            })
            .collect();
        svg.polyline(&points, color);
    }
    let legend: Vec<(&str, &str)> = lines
        .iter()
        .map(|(color, name, _)| (*color, *name))
        .collect();
    draw_legend(&mut svg, &legend);
    svg.finish("percentile curves")
}

fn decades(share: f64) -> f64 {
    -(1.0 - share).log10()
}
