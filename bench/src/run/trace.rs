//! `--trace`: one frame across processes, as Chrome's trace format (read by Perfetto and chrome://tracing).
//!
//! Every process writes its spans as lines while it runs; the sequence in each of them ties a frame together. Times are
//! CLOCK_MONOTONIC, the same in all processes, so nothing has to be aligned.

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::fs;
use std::path::Path;
use std::str::FromStr;

use anyhow::{Context, Result, ensure};
use serde::Deserialize;
use serde_json::{Value, json};
use tempfile::TempDir;

use crate::report::{FrameRecord, STAGES};

/// Names the folder into which the processes write their spans.
const SPANS_VARIABLE: &str = "MLUC_SPANS";

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

/// Where the processes write their spans, for as long as the measurement lasts.
pub(crate) struct SpansFolder(TempDir);

impl SpansFolder {
    pub(crate) fn make() -> Result<SpansFolder> {
        let folder = tempfile::tempdir().context("making a folder for spans")?;
        Ok(SpansFolder(folder))
    }

    pub(crate) fn variable(&self) -> (&'static str, &OsStr) {
        (SPANS_VARIABLE, self.0.path().as_os_str())
    }

    /// Writes the trace; what it is of, for the terminal.
    pub(crate) fn write_trace(
        &self,
        file: &Path,
        which: Which,
        frames: &[FrameRecord],
    ) -> Result<String> {
        let sequence = which.sequence(frames)?;
        let one = |sequence| format!("frame {sequence}");
        let text = sequence.map_or("all frames".to_string(), one);
        let mut spans = self.read()?;
        spans.retain(|span| sequence.is_none_or(|sequence| sequence == span.sequence));
        ensure!(
            !spans.is_empty(),
            "no spans of {text}: was it dropped, or does the run have fewer frames?"
        );
        let trace = chrome_trace(spans).to_string();
        let place = file.display();
        fs::write(file, trace).with_context(|| format!("writing {place}"))?;
        Ok(format!(
            "{text}: {place} (open it in ui.perfetto.dev or chrome://tracing)"
        ))
    }

    fn read(&self) -> Result<Vec<Span>> {
        let place = self.0.path().display();
        let entries = fs::read_dir(self.0.path()).with_context(|| format!("spans in {place}"))?;
        let mut spans = Vec::new();
        for path in entries.flatten().map(|entry| entry.path()) {
            let text = fs::read_to_string(&path);
            let text = text.with_context(|| format!("reading {}", path.display()))?;
            spans.extend(text.lines().filter_map(parse_span));
        }
        Ok(spans)
    }
}

/// A piece of work of one process for one frame; times on CLOCK_MONOTONIC.
#[derive(Clone, Debug, PartialEq, Deserialize)]
struct Span {
    process: String,
    pid: u32,
    tid: u64,
    name: String,
    sequence: u64,
    begin_ns: u64,
    end_ns: u64,
}

impl Span {
    fn ns(&self) -> u64 {
        self.end_ns - self.begin_ns
    }
}

/// A span from its line; `None`: a line that a killed process did not finish.
fn parse_span(line: &str) -> Option<Span> {
    let span: Span = serde_json::from_str(line).ok()?;
    (span.end_ns >= span.begin_ns).then_some(span)
}

/// The trace file. Times begin at the first span. Arrows lead from each stage's publication to the next stage's work on
/// the same frame.
fn chrome_trace(mut spans: Vec<Span>) -> Value {
    spans.sort_by_key(|span| (span.begin_ns, u64::MAX - span.end_ns));
    let zero_ns = spans.first().map_or(0, |span| span.begin_ns);
    let us = |ns: u64| ns.saturating_sub(zero_ns) as f64 / 1000.0;
    let mut events = processes(&spans);
    events.extend(spans.iter().map(|span| {
        json!({"name": span.name, "cat": "frame", "ph": "X", "ts": us(span.begin_ns), "dur": us(span.end_ns) - us(span.begin_ns),
               "pid": span.pid, "tid": span.tid, "args": {"sequence": span.sequence}})
    }));
    for (number, (from, to)) in hand_overs(&spans).into_iter().enumerate() {
        for (phase, span, ns) in [("s", from, from.end_ns), ("f", to, to.begin_ns)] {
            events.push(json!({"name": "hand-over", "cat": "hand-over", "ph": phase, "id": number, "ts": us(ns), "pid": span.pid,
                               "tid": span.tid, "bp": "e", "args": {"sequence": span.sequence}}));
        }
    }
    json!({"displayTimeUnit": "ms", "traceEvents": events})
}

fn stage_of(process: &str) -> Option<usize> {
    STAGES.iter().position(|stage| *stage == process)
}

fn processes(spans: &[Span]) -> Vec<Value> {
    let names: BTreeMap<u32, &str> = spans.iter().map(|s| (s.pid, s.process.as_str())).collect();
    let names = names.into_iter().flat_map(|(pid, name)| {
        let index = stage_of(name).unwrap_or(STAGES.len());
        [
            json!({"name": "process_name", "ph": "M", "pid": pid, "args": {"name": name}}),
            json!({"name": "process_sort_index", "ph": "M", "pid": pid, "args": {"sort_index": index}}),
        ]
    });
    names.collect()
}

/// Per frame and pair of neighbouring stages: the longest span of each, the one that spans the whole frame.
fn hand_overs(spans: &[Span]) -> Vec<(&Span, &Span)> {
    let mut whole: BTreeMap<(u64, usize), &Span> = BTreeMap::new();
    for span in spans {
        let Some(stage) = stage_of(&span.process) else {
            continue;
        };
        let longest = whole.entry((span.sequence, stage)).or_insert(span);
        if span.ns() > longest.ns() {
            *longest = span;
        }
    }
    let pair = |(&(sequence, stage), &from)| Some((from, *whole.get(&(sequence, stage + 1))?));
    whole.iter().filter_map(pair).collect()
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

    const LINES: [&str; 3] = [
        r#"{"process":"ingest","pid":10,"tid":1,"name":"frame","sequence":7,"begin_ns":1000000,"end_ns":2000000}"#,
        r#"{"process":"backbone","pid":11,"tid":1,"name":"frame","sequence":7,"begin_ns":2050000,"end_ns":9000000}"#,
        r#"{"process":"backbone","pid":11,"tid":1,"name":"run","sequence":7,"begin_ns":2060000,"end_ns":8000000}"#,
    ];

    #[test]
    fn the_spans_of_a_frame_are_tied_together() {
        let trace = chrome_trace(LINES.into_iter().filter_map(parse_span).collect());
        let events = trace["traceEvents"].as_array().unwrap();
        let hand_over = events.iter().filter(|event| event["name"] == "hand-over");
        let ends = hand_over.map(|event| json!([event["ph"], event["pid"], event["ts"]]));
        let expected = [json!(["s", 10, 1000.0]), json!(["f", 11, 1050.0])];
        assert_eq!(ends.collect::<Vec<_>>(), expected);
        // Two names and two places, three spans.
        assert_eq!((events.len(), &events[5]["dur"]), (9, &json!(6950.0)));
    }

    #[test]
    fn half_lines_are_left_out() {
        for half in [&LINES[0][..LINES[0].len() / 2], ""] {
            assert_eq!(parse_span(half), None);
        }
    }
}
