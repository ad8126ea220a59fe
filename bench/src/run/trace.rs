//! `--trace`: frames across processes, as Chrome's trace format (read by Perfetto and chrome://tracing).
//!
//! Made of the stamps in the frames' headers. They are on CLOCK_MONOTONIC, the same in all processes, so nothing has to be
//! aligned.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result};
use serde_json::{Value, json};

use crate::report::{FrameRecord, STAGES, micros};

/// Writes the trace of all frames that came out; what it is, for the terminal.
pub(crate) fn write_trace(file: &Path, frames: &[FrameRecord]) -> Result<String> {
    let place = file.display();
    fs::write(file, chrome_trace(frames).to_string())
        .with_context(|| format!("writing {place}"))?;
    Ok(format!(
        "all frames: {place} (open it in ui.perfetto.dev or chrome://tracing)"
    ))
}

/// The trace file: a lane a stage, in it `wait` (taken, not begun) and `run` (computing and publishing). Times begin when the
/// round's first frame was due. Arrows lead from each stage's publication to the next stage's taking of the same frame.
fn chrome_trace(frames: &[FrameRecord]) -> Value {
    let name = |(stage, name)| json!({"name": "process_name", "ph": "M", "pid": stage, "args": {"name": name}});
    let mut events: Vec<Value> = STAGES.iter().enumerate().map(name).collect();
    for (frame, stamps) in frames
        .iter()
        .filter_map(|frame| Some((frame, frame.stamps?)))
    {
        let about = json!({"sequence": frame.sequence, "scan": frame.name});
        for (stage, own) in stamps.iter().enumerate() {
            let spans = [
                ("wait", own.received_ns, own.started_ns),
                ("run", own.started_ns, own.published_ns),
            ];
            events.extend(spans.map(|(name, begin_ns, end_ns)| {
                json!({"name": name, "cat": "frame", "ph": "X", "ts": micros(begin_ns), "dur": micros(end_ns - begin_ns),
                       "pid": stage, "tid": 0, "args": about})
            }));
        }
        for (stage, pair) in stamps.windows(2).enumerate() {
            let ends = [
                ("s", stage, pair[0].published_ns),
                ("f", stage + 1, pair[1].received_ns),
            ];
            let id = format!("{}-{stage}", frame.sequence);
            events.extend(ends.map(|(phase, stage, ns)| {
                json!({"name": "hand-over", "cat": "hand-over", "ph": phase, "id": id, "ts": micros(ns), "pid": stage, "tid": 0,
                       "bp": "e", "args": about})
            }));
        }
    }
    json!({"displayTimeUnit": "ms", "traceEvents": events})
}
