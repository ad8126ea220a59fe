//! The page's pictures: latency and CPU over time, where the time of single frames went, percentiles and histograms.

use mluc_geometry::quantile;

use super::frame::{FrameRecord, STAGES, micros};
use super::series::{Series, series, sorted};
use crate::svg::{ALARM_COLOR, QUEUE_COLOR, STAGE_COLORS, TOTAL_COLOR};
use crate::svg::{Scale, Svg, short};

/// What the stages took of the machine between two looks.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Sample {
    /// Since the first frame of the first round was due, s.
    pub(crate) at_s: f64,
    /// CPU time over time by stage: 1 is a core.
    pub(crate) cpu_cores: [f64; 4],
    pub(crate) memory_mib: [f64; 4],
}

const WIDTH: f64 = 980.0;
/// Left and right edge of a plot.
const ACROSS: [f64; 2] = [62.0, WIDTH - 20.0];
const WARM_UP_COLOR: &str = "#9aa2ab";
/// More dots than this are thinned: a page stays small; dropped and slowest frames are never left out.
const DOTS_MAX: usize = 4000;
/// Where the slowest frame is so much above the median a linear axis would show a flat line.
const LOG_FROM: f64 = 6.0;

pub(crate) fn latency_over_time(frames: &[FrameRecord], period_ms: Option<f64>) -> String {
    let latency_us = series(frames).latency_us;
    let latency_ms: Vec<f64> = latency_us.iter().map(|us| us / 1000.0).collect();
    let ascending = sorted(&latency_ms);
    let quantiles = [0.0, 0.5, 0.99, 1.0].map(|q| quantile(&ascending, q));
    let [Some(least), Some(median), Some(ninth), Some(most)] = quantiles else {
        return String::new();
    };
    let [top, bottom] = [26.0, 250.0];
    let high = most.max(period_ms.unwrap_or(0.0)) * 1.05;
    let y = if most > LOG_FROM * median.max(0.001) {
        Scale::log([(least * 0.8).max(0.01), high], [bottom, top])
    } else {
        Scale::linear([0.0, high], [bottom, top])
    };
    let starts_s = round_starts_s(frames);
    let at_s = |frame: &FrameRecord| starts_s[frame.round as usize] + frame.due_ns as f64 * 1e-9;
    let end_s = frames.iter().map(at_s).fold(0.0, f64::max);
    let x = Scale::linear([0.0, end_s], ACROSS);
    let mut svg = Svg::new(WIDTH, 290.0);
    svg.vertical_axis(&y, ACROSS, "ms");
    svg.horizontal_axis(&x, [top, bottom], "time, s");
    if let Some(period_ms) = period_ms {
        let ([left, right], at) = (ACROSS, y.place(period_ms));
        svg.line([left, at], [right, at], "mark");
        let text = format!("period {} ms", short(period_ms));
        svg.text([right, at - 5.0], "end", &text);
    }
    let step = latency_ms.len().div_ceil(DOTS_MAX).max(1);
    for (index, (frame, &ms)) in frames.iter().zip(&latency_ms).enumerate() {
        let at = [x.place(at_s(frame)), y.place(ms)];
        let (sequence, round, time) = (frame.sequence, frame.round, short(ms));
        let tip = format!("frame {sequence} of round {round}: {time} ms");
        if !frame.is_out() {
            svg.cross(at, &(tip + ", dropped"));
        } else if index % step == 0 || ms >= ninth {
            if frame.is_warm_up {
                svg.dot(at, WARM_UP_COLOR, &(tip + ", warm-up"));
            } else {
                svg.dot(at, TOTAL_COLOR, &tip);
            }
        }
    }
    let legend = [
        (TOTAL_COLOR, "came out"),
        (ALARM_COLOR, "dropped: until a newer one was out"),
        (WARM_UP_COLOR, "warm-up"),
    ];
    svg.legend(ACROSS[0], legend);
    svg.finish("latency of each frame over time")
}

fn round_starts_s(frames: &[FrameRecord]) -> Vec<f64> {
    let first = frames.first().map_or(0, |frame| frame.round as usize);
    let mut starts_s = vec![0.0; first + 1];
    for pair in frames.windows(2) {
        if pair[0].round < pair[1].round {
            let length_s = pair[0].due_ns as f64 * 1e-9 + 1.0;
            let next_s = starts_s.last().map_or(0.0, |start_s| start_s + length_s);
            starts_s.resize(pair[1].round as usize + 1, next_s);
        }
    }
    starts_s
}

pub(crate) fn cpu_over_time(samples: &[Sample]) -> String {
    let Some(last) = samples.last() else {
        return String::new();
    };
    let [top, bottom] = [26.0, 170.0];
    let most = samples.iter().flat_map(|s| s.cpu_cores).fold(0.1, f64::max);
    let y = Scale::linear([0.0, most * 1.08], [bottom, top]);
    let x = Scale::linear([0.0, last.at_s], ACROSS);
    let mut svg = Svg::new(WIDTH, 208.0);
    svg.vertical_axis(&y, ACROSS, "cores");
    svg.horizontal_axis(&x, [top, bottom], "time, s");
    for (stage, color) in STAGE_COLORS.iter().enumerate() {
        let point = |s: &Sample| [x.place(s.at_s), y.place(s.cpu_cores[stage])];
        svg.polyline(samples.iter().map(point), color);
    }
    svg.legend(ACROSS[0], STAGE_COLORS.into_iter().zip(STAGES));
    svg.finish("CPU of each stage over time")
}

/// Height of a stage's lane.
const LANE: f64 = 17.0;
/// From one frame's lanes to the next ones.
const BLOCK: f64 = LANE * 4.0 + 24.0;

/// The median frame and the slowest ones of those that came out, on one scale: a lane a stage, waiting pale, computing full.
pub(crate) fn waterfall(frames: &[FrameRecord]) -> String {
    let measured = frames.iter().filter(|frame| !frame.is_warm_up);
    let mut out: Vec<(f64, &FrameRecord)> = measured
        .filter_map(|frame| Some((frame.delivered_us()? / 1000.0, frame)))
        .collect();
    out.sort_by(|a, b| a.0.total_cmp(&b.0));
    let Some(&(slowest_ms, _)) = out.last() else {
        return String::new();
    };
    let (median, others) = (out[(out.len() - 1) / 2], out.len() - 1);
    let words = ["slowest", "second slowest", "third slowest"];
    let slowest = words.into_iter().zip(out.into_iter().rev().take(others));
    let chosen: Vec<_> = [("median", median)].into_iter().chain(slowest).collect();
    let x = Scale::linear([0.0, slowest_ms * 1.02], [215.0, 930.0]);
    let bottom = 10.0 + BLOCK * chosen.len() as f64;
    let mut svg = Svg::new(WIDTH, bottom + 36.0);
    svg.horizontal_axis(&x, [4.0, bottom], "ms since the scan was due");
    for (number, (word, (ms, frame))) in chosen.into_iter().enumerate() {
        let top = 8.0 + BLOCK * number as f64;
        let time = format!("{} ms", short(ms));
        let name = format!("frame {}", frame.sequence);
        for (line, text) in [word, &time, &name].into_iter().enumerate() {
            svg.text([8.0, top + 13.0 + 16.0 * line as f64], "start", text);
        }
        lanes(&mut svg, frame, top, &x);
    }
    svg.finish("where the time of the median and of the slowest frames went")
}

fn lanes(svg: &mut Svg, frame: &FrameRecord, top: f64, x: &Scale) {
    let at = |ns: i64| x.place(micros(ns - frame.due_ns) / 1000.0);
    let ms = |us: Option<f64>| short(us.unwrap_or(0.0) / 1000.0);
    let mut input = x.place(0.0);
    for (stage, own) in frame.stamps.iter().flatten().enumerate() {
        let y = top + LANE * stage as f64;
        let (begin, end) = (at(own.started_ns), at(own.published_ns));
        svg.text([x.place(0.0) - 8.0, y + 12.0], "end", STAGES[stage]);
        let (queue, run) = (ms(frame.queue_us(stage)), ms(frame.run_us(stage)));
        let waiting = [input, y + 4.0, begin - input, LANE - 8.0];
        svg.rect(waiting, QUEUE_COLOR, &format!("queue {queue} ms"));
        // A stage of microseconds is still to be seen.
        let wide = (end - begin).max(1.5);
        let computing = [begin, y + 1.0, wide, LANE - 3.0];
        svg.rect(computing, STAGE_COLORS[stage], &format!("run {run} ms"));
        let beside = [begin + wide + 5.0, y + 12.0];
        svg.text(beside, "start", &format!("{run} ms"));
        input = end;
    }
}

/// Percentile curves: to the right the rarer frames, each step ten times as rare.
pub(crate) fn percentile_curves(series: &Series) -> String {
    let [top, bottom] = [26.0, 290.0];
    let mut lines = vec![(TOTAL_COLOR, "end to end", sorted(&series.latency_us))];
    for (stage, run_us) in series.run_us.iter().enumerate() {
        lines.push((STAGE_COLORS[stage], STAGES[stage], sorted(run_us)));
    }
    let values = || lines.iter().flat_map(|line| &line.2).copied();
    let low = values().fold(f64::INFINITY, f64::min);
    let high = values().fold(0.0, f64::max);
    if !low.is_finite() || high <= 0.0 {
        return String::new();
    }
    let range_ms = [low.max(1.0) / 1000.0 * 0.8, high / 1000.0 * 1.1];
    let y = Scale::log(range_ms, [bottom, top]);
    // Three decades: 0, 90, 99, 99.9 %.
    let x = Scale::linear([0.0, 3.0], ACROSS);
    let mut svg = Svg::new(WIDTH, 330.0);
    svg.vertical_axis(&y, ACROSS, "ms");
    for percent in [0.0f64, 50.0, 90.0, 99.0, 99.9] {
        let at = x.place(-(1.0 - percent / 100.0).log10());
        svg.line([at, top], [at, bottom], "grid");
        svg.text([at, bottom + 15.0], "middle", &format!("{percent} %"));
    }
    let text = "share of frames that are at most so late";
    svg.text([ACROSS[1], bottom + 30.0], "end", text);
    for (color, _, values_us) in &lines {
        let points = (0..=150).filter_map(|step| {
            let decade = f64::from(step) / 50.0;
            let us = quantile(values_us, 1.0 - 10f64.powf(-decade))?;
            Some([x.place(decade), y.place(us / 1000.0)])
        });
        svg.polyline(points, color);
    }
    svg.legend(ACROSS[0], lines.iter().map(|line| (line.0, line.1)));
    svg.finish("percentile curves")
}

/// Two small histograms a stage: queue above, run below; logarithmic in time, each with its own range.
pub(crate) fn histograms(series: &Series) -> String {
    let mut svg = Svg::new(WIDTH, 330.0);
    for (stage, name) in STAGES.iter().enumerate() {
        let left = 20.0 + 242.0 * stage as f64;
        let (queue_us, run_us) = (&series.queue_us[stage], &series.run_us[stage]);
        svg.text([left, 14.0], "start", name);
        let (queue, run) = (("queue", QUEUE_COLOR), ("run", STAGE_COLORS[stage]));
        histogram(&mut svg, [left, 38.0], queue, queue_us);
        histogram(&mut svg, [left, 196.0], run, run_us);
    }
    svg.finish("histograms of queueing and computing, by stage")
}

fn histogram(svg: &mut Svg, [left, top]: [f64; 2], (what, color): (&str, &str), us: &[f64]) {
    const BARS: usize = 36;
    let (width, height) = (216.0, 84.0);
    let ascending = sorted(us);
    let (Some(&low), Some(&high)) = (ascending.first(), ascending.last()) else {
        let text = format!("{what}: no frames");
        svg.text([left, top + 40.0], "start", &text);
        return;
    };
    let range_ms = [low.max(1.0) / 1000.0 * 0.95, high.max(1.1) / 1000.0 * 1.05];
    let (right, bottom) = (left + width, top + height);
    let x = Scale::log(range_ms, [left, right]);
    let mut counts = [0usize; BARS];
    for us in &ascending {
        let share = (x.place(us / 1000.0) - left) / width;
        counts[((share * BARS as f64) as usize).min(BARS - 1)] += 1;
    }
    let most = counts.into_iter().max().unwrap_or(1) as f64;
    let bar = width / BARS as f64;
    for (index, &count) in counts.iter().enumerate().filter(|(_, count)| **count > 0) {
        let tall = (count as f64 / most * height).max(1.5);
        let place = [left + bar * index as f64, bottom - tall, bar - 1.0, tall];
        svg.rect(place, color, &format!("{count} frames"));
    }
    svg.line([left, bottom], [right, bottom], "axis");
    let ends = [(left, "start"), (right, "end")];
    for ((at, anchor), ms) in ends.into_iter().zip(range_ms) {
        svg.text([at, bottom + 15.0], anchor, &format!("{} ms", short(ms)));
    }
    for (word, q) in [("p50", 0.5), ("p99", 0.99)] {
        let at = x.place(quantile(&ascending, q).unwrap_or(low) / 1000.0);
        svg.line([at, top - 2.0], [at, bottom], "mark");
        svg.text([at, top - 5.0], "middle", word);
    }
    svg.text([left + width / 2.0, bottom + 28.0], "middle", what);
}
