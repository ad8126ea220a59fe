//! Where the time of single frames went: a lane a stage, waiting pale, computing full.

use super::frame::{FrameRecord, STAGES, micros};
use crate::svg::{Anchor, QUEUE_COLOR, STAGE_COLORS, Scale, Svg, horizontal_axis, short};

const WIDTH: f64 = 980.0;
const LEFT: f64 = 215.0;
const RIGHT: f64 = 930.0;
const LANE: f64 = 17.0;
/// Between two frames.
const GAP: f64 = 24.0;
/// Slow frames that are drawn.
const WORST: usize = 3;

/// The median frame and the slowest ones of those that came out, on one scale.
pub(crate) fn waterfall(frames: &[FrameRecord]) -> String {
    let mut out: Vec<(&FrameRecord, f64)> = frames
        .iter()
        .filter(|frame| !frame.is_warm_up)
        .filter_map(|frame| Some((frame, micros(frame.published_ns()? - frame.due_ns) / 1000.0)))
        .collect();
    out.sort_by(|a, b| a.1.total_cmp(&b.1));
    let Some(&(_, slowest_ms)) = out.last() else {
        return String::new();
    };
    let mut chosen = vec![("median", out[(out.len() - 1) / 2])];
    let words = ["slowest", "second slowest", "third slowest"];
    chosen.extend(
        words
            .into_iter()
            .zip(out.iter().rev().take(WORST.min(out.len() - 1)).copied()),
    );
    let x = Scale::linear([0.0, slowest_ms * 1.02], [LEFT, RIGHT]);
    let block = LANE * STAGES.len() as f64 + GAP;
    let bottom = 10.0 + block * chosen.len() as f64;
    let mut svg = Svg::new(WIDTH, bottom + 36.0);
    horizontal_axis(&mut svg, &x, 4.0, bottom, "ms since the scan was due");
    for (number, (word, (frame, ms))) in chosen.into_iter().enumerate() {
        let top = 8.0 + block * number as f64;
        svg.text([8.0, top + 13.0], Anchor::Start, word);
        svg.text(
            [8.0, top + 29.0],
            Anchor::Start,
            &format!("{} ms", short(ms)),
        );
        svg.text(
            [8.0, top + 45.0],
            Anchor::Start,
            &format!("frame {}", frame.sequence),
        );
        lanes(&mut svg, frame, top, &x);
    }
    svg.finish("where the time of the median and of the slowest frames went")
}

fn lanes(svg: &mut Svg, frame: &FrameRecord, top: f64, x: &Scale) {
    let Some(stamps) = frame.stamps else {
        return;
    };
    let at = |ns: i64| x.place(micros(ns - frame.due_ns) / 1000.0);
    let mut input_ns = frame.due_ns;
    for (stage, own) in stamps.iter().enumerate() {
        let y = top + LANE * stage as f64;
        svg.text([LEFT - 8.0, y + 12.0], Anchor::End, STAGES[stage]);
        let (queue_ms, run_ms) = (
            micros(own.started_ns - input_ns) / 1000.0,
            micros(own.published_ns - own.started_ns) / 1000.0,
        );
        let (from, begin, end) = (at(input_ns), at(own.started_ns), at(own.published_ns));
        svg.rect(
            [from, y + 4.0, begin - from, LANE - 8.0],
            QUEUE_COLOR,
            &format!("queue {} ms", short(queue_ms)),
        );
        // A stage of microseconds is still to be seen.
        let wide = (end - begin).max(1.5);
        svg.rect(
            [begin, y + 1.0, wide, LANE - 3.0],
            STAGE_COLORS[stage],
            &format!("run {} ms", short(run_ms)),
        );
        svg.text(
            [begin + wide + 5.0, y + 12.0],
            Anchor::Start,
            &format!("{} ms", short(run_ms)),
        );
        input_ns = own.published_ns;
    }
}
