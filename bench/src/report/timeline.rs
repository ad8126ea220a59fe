//! Over time: latency of each frame, and CPU of each stage.

use super::frame::{FrameRecord, STAGES};
use super::series::series;
use crate::svg::{
    ALARM_COLOR, Anchor, STAGE_COLORS, Scale, Svg, TOTAL_COLOR, horizontal_axis, short,
    vertical_axis,
};

/// What the stages took of the machine between two looks.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Sample {
    /// Since the first frame of the first round was due, s.
    pub(crate) at_s: f64,
    /// CPU time over time by stage: 1 is a core.
    pub(crate) cpu_cores: [f64; 4],
    /// Private memory by stage, MiB.
    pub(crate) memory_mib: [f64; 4],
}

const WIDTH: f64 = 980.0;
const LEFT: f64 = 62.0;
const RIGHT: f64 = WIDTH - 20.0;
/// More dots than this are thinned: a page stays small; dropped and slowest frames are never left out.
const DOTS_MAX: usize = 4000;
/// Where the slowest frame is so much above the median a linear axis would show a flat line.
const LOG_FROM: f64 = 6.0;

/// Every frame's latency; rounds one after the other.
pub(crate) fn latency_over_time(frames: &[FrameRecord], period_ms: Option<f64>) -> String {
    let latency_ms: Vec<f64> = series(frames)
        .latency_us
        .iter()
        .map(|us| us / 1000.0)
        .collect();
    let (top, bottom) = (26.0, 250.0);
    let mut svg = Svg::new(WIDTH, 290.0);
    let sorted = super::statistics::sorted(&latency_ms);
    let (Some(&least), Some(&most)) = (sorted.first(), sorted.last()) else {
        return String::new();
    };
    let (median, ninth) = (sorted[sorted.len() / 2], sorted[sorted.len() * 99 / 100]);
    let high = most.max(period_ms.unwrap_or(0.0)) * 1.05;
    let y = if most > LOG_FROM * median.max(0.001) {
        Scale::log([(least * 0.8).max(0.01), high], [bottom, top])
    } else {
        Scale::linear([0.0, high], [bottom, top])
    };
    let starts_s = round_starts_s(frames);
    let at_s = |frame: &FrameRecord| starts_s[frame.round as usize] + frame.due_ns as f64 * 1e-9;
    let end_s = frames.iter().map(&at_s).fold(0.0, f64::max);
    let x = Scale::linear([0.0, end_s], [LEFT, RIGHT]);
    vertical_axis(&mut svg, &y, LEFT, RIGHT, "ms");
    horizontal_axis(&mut svg, &x, top, bottom, "time, s");
    if let Some(period_ms) = period_ms {
        let at = y.place(period_ms);
        svg.line([LEFT, at], [RIGHT, at], "mark");
        svg.text(
            [RIGHT, at - 5.0],
            Anchor::End,
            &format!("period {} ms", short(period_ms)),
        );
    }
    let step = latency_ms.len().div_ceil(DOTS_MAX).max(1);
    for (index, (frame, &ms)) in frames.iter().zip(&latency_ms).enumerate() {
        let at = [x.place(at_s(frame)), y.place(ms)];
        let tip = format!(
            "frame {} of round {}: {} ms",
            frame.sequence,
            frame.round,
            short(ms)
        );
        match (frame.is_out(), frame.is_warm_up) {
            (false, _) => svg.cross(at, 6.0, &format!("{tip}, dropped")),
            (true, _) if index % step != 0 && ms < ninth => (),
            (true, true) => svg.dot(at, 2.0, "#9aa2ab", &format!("{tip}, warm-up")),
            (true, false) => svg.dot(at, 2.2, TOTAL_COLOR, &tip),
        }
    }
    let legend = [
        (TOTAL_COLOR, "came out"),
        (ALARM_COLOR, "dropped: until a newer one was out"),
        ("#9aa2ab", "warm-up"),
    ];
    draw_legend(&mut svg, &legend);
    svg.finish("latency of each frame over time")
}

/// Where each round begins on a common axis, s.
fn round_starts_s(frames: &[FrameRecord]) -> Vec<f64> {
    let rounds = frames.iter().map(|frame| frame.round).max().unwrap_or(0) as usize + 1;
    let mut lengths_s = vec![0f64; rounds];
    for frame in frames {
        let length = &mut lengths_s[frame.round as usize];
        *length = length.max(frame.due_ns as f64 * 1e-9);
    }
    let mut start_s = 0.0;
    lengths_s
        .into_iter()
        .map(|length_s| {
            let start = start_s;
            start_s += length_s + 1.0;
            start
        })
        .collect()
}

/// CPU of each stage.
pub(crate) fn cpu_over_time(samples: &[Sample]) -> String {
    let (top, bottom) = (26.0, 170.0);
    let mut svg = Svg::new(WIDTH, 208.0);
    let Some(last) = samples.last() else {
        return String::new();
    };
    let most = samples.iter().flat_map(|s| s.cpu_cores).fold(0.1, f64::max);
    let y = Scale::linear([0.0, most * 1.08], [bottom, top]);
    let x = Scale::linear([0.0, last.at_s], [LEFT, RIGHT]);
    vertical_axis(&mut svg, &y, LEFT, RIGHT, "cores");
    horizontal_axis(&mut svg, &x, top, bottom, "time, s");
    for (stage, color) in STAGE_COLORS.iter().enumerate() {
        let points: Vec<[f64; 2]> = samples
            .iter()
            .map(|sample| [x.place(sample.at_s), y.place(sample.cpu_cores[stage])])
            .collect();
        svg.polyline(&points, color);
    }
    let legend: Vec<(&str, &str)> = STAGE_COLORS.into_iter().zip(STAGES).collect();
    draw_legend(&mut svg, &legend);
    svg.finish("CPU of each stage over time")
}

pub(crate) fn draw_legend(svg: &mut Svg, entries: &[(&str, &str)]) {
    let mut x = LEFT;
    for (color, text) in entries {
        svg.rect([x, 4.0, 11.0, 11.0], color, "");
        svg.text([x + 16.0, 14.0], Anchor::Start, text);
        x += 34.0 + 7.0 * text.len() as f64;
    }
}
