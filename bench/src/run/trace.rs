//! `--trace`: frames across processes, as Chrome's trace format (read by Perfetto and chrome://tracing).
//!
//! Made of the stamps in the frames' headers. They are on CLOCK_MONOTONIC, the same in all processes, so nothing has to be
//! aligned.

use std::fs;
use std::path::Path;
use std::str::FromStr;

use anyhow::{Context, Result, ensure};
use serde_json::{Value, json};

use crate::report::{FrameRecord, STAGES, micros};

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Which {
    #[default]
    Median,
    Worst,
    All,
    Sequence(u64),
}

impl FromStr for Which {
    type Err = String;

    fn from_str(word: &str) -> Result<Which, String> {
        let expected = "expected median, worst, first, all or a sequence";
        Ok(match word {
            "median" => Which::Median,
            "worst" => Which::Worst,
            "first" => Which::Sequence(0),
            "all" => Which::All,
            number => Which::Sequence(number.parse().map_err(|_| expected)?),
        })
    }
}

impl Which {
    /// `None`: all of them.
    fn sequence(self, frames: &[FrameRecord]) -> Result<Option<u64>> {
        let measured = frames.iter().filter(|frame| !frame.is_warm_up);
        let mut out: Vec<(i64, u64)> = measured
            .filter_map(|frame| Some((frame.published_ns()? - frame.due_ns, frame.sequence)))
            .collect();
        out.sort_unstable();
        let chosen = match self {
            Which::All => return Ok(None),
            Which::Sequence(sequence) => return Ok(Some(sequence)),
            Which::Median => out.get(out.len().saturating_sub(1) / 2),
            Which::Worst => out.last(),
        };
        let chosen = chosen.map(|&(_, sequence)| sequence);
        chosen.context("no frame came out: no trace").map(Some)
    }
}

/// Writes the trace; what it is of, for the terminal.
pub(crate) fn write_trace(file: &Path, which: Which, frames: &[FrameRecord]) -> Result<String> {
    let sequence = which.sequence(frames)?;
    let one = |sequence| format!("frame {sequence}");
    let text = sequence.map_or("all frames".to_string(), one);
    let is_meant = |frame: &&FrameRecord| {
        frame.is_out() && sequence.is_none_or(|sequence| sequence == frame.sequence)
    };
    let meant: Vec<&FrameRecord> = frames.iter().filter(is_meant).collect();
    ensure!(
        !meant.is_empty(),
        "no stamps of {text}: was it dropped, or does the run have fewer frames?"
    );
    let place = file.display();
    fs::write(file, chrome_trace(&meant).to_string())
        .with_context(|| format!("writing {place}"))?;
    Ok(format!(
        "{text}: {place} (open it in ui.perfetto.dev or chrome://tracing)"
    ))
}

/// The trace file: a lane a stage, in it `wait` (taken, not begun) and `run` (computing and publishing). Times begin when the
/// round's first frame was due. Arrows lead from each stage's publication to the next stage's taking of the same frame.
fn chrome_trace(frames: &[&FrameRecord]) -> Value {
    let name = |(stage, name)| json!({"name": "process_name", "ph": "M", "pid": stage, "args": {"name": name}});
    let mut events: Vec<Value> = STAGES.iter().enumerate().map(name).collect();
    for frame in frames {
        let (about, stamps) = (
            json!({"sequence": frame.sequence, "scan": frame.name}),
            frame.stamps.unwrap_or_default(),
        );
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_chosen_by_word_or_number() {
        assert_eq!("worst".parse(), Ok(Which::Worst));
        assert_eq!("17".parse(), Ok(Which::Sequence(17)));
        assert!("wurst".parse::<Which>().is_err());
        assert!(Which::Median.sequence(&[]).is_err());
    }
}
