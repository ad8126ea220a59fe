//! One frame across processes, as Chrome's trace format (read by Perfetto and chrome://tracing).
//!
//! Every process writes its spans as lines while it runs; the sequence in each of them ties a frame together. Times are
//! CLOCK_MONOTONIC, the same in all processes, so nothing has to be aligned.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

/// A piece of work of one process for one frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Span {
    /// Name of the process: a stage's.
    pub(crate) process: String,
    /// Its number.
    pub(crate) pid: u32,
    /// Thread inside of it.
    pub(crate) tid: u64,
    /// What was done.
    pub(crate) name: String,
    /// Which frame.
    pub(crate) sequence: u64,
    /// Begin, CLOCK_MONOTONIC, ns.
    pub(crate) begin_ns: u64,
    /// End.
    pub(crate) end_ns: u64,
}

/// Which frames a trace shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Selection {
    /// Those of one sequence.
    Frame(u64),
    /// All.
    All,
}

/// A span from its line; `None`: a line that a killed process did not finish.
pub(crate) fn parse_span(line: &str) -> Option<Span> {
    let span: Span = serde_json::from_str(line).ok()?;
    (span.end_ns >= span.begin_ns).then_some(span)
}

/// The trace file. Times begin at the first span shown. Arrows lead from each stage's publication to the next stage's
/// work on the same frame.
pub(crate) fn chrome_trace(spans: &[Span], selection: Selection) -> Value {
    let is_shown =
        |span: &&Span| selection == Selection::All || selection == Selection::Frame(span.sequence);
    let mut shown: Vec<&Span> = spans.iter().filter(is_shown).collect();
    shown.sort_by_key(|span| (span.begin_ns, u64::MAX - span.end_ns));
    let zero_ns = shown.first().map_or(0, |span| span.begin_ns);
    let us = |ns: u64| ns.saturating_sub(zero_ns) as f64 / 1000.0;
    let mut events: Vec<Value> = processes(&shown);
    events.extend(shown.iter().map(|span| {
        json!({"name": span.name, "cat": "frame", "ph": "X", "ts": us(span.begin_ns), "dur": us(span.end_ns) - us(span.begin_ns),
               "pid": span.pid, "tid": span.tid, "args": {"sequence": span.sequence}})
    }));
    for (number, (from, to)) in hand_overs(&shown).into_iter().enumerate() {
        let arrow = |phase: &str, span: &Span, ns: u64| {
            json!({"name": "hand-over", "cat": "hand-over", "ph": phase, "id": number, "ts": us(ns), "pid": span.pid,
                   "tid": span.tid, "bp": "e", "args": {"sequence": span.sequence}})
        };
        events.push(arrow("s", from, from.end_ns));
        events.push(arrow("f", to, to.begin_ns));
    }
    json!({"displayTimeUnit": "ms", "traceEvents": events})
}

/// Names, in the order of the stages.
fn processes(spans: &[&Span]) -> Vec<Value> {
    let names: BTreeMap<u32, &str> = spans
        .iter()
        .map(|span| (span.pid, span.process.as_str()))
        .collect();
    let place = |name: &str| {
        super::frame::STAGES
            .iter()
            .position(|stage| *stage == name)
            .unwrap_or(super::frame::STAGES.len())
    };
    names
        .into_iter()
        .flat_map(|(pid, name)| {
            [
                json!({"name": "process_name", "ph": "M", "pid": pid, "args": {"name": name}}),
                json!({"name": "process_sort_index", "ph": "M", "pid": pid, "args": {"sort_index": place(name)}}),
            ]
        })
        .collect()
}

/// Per frame and pair of neighbouring stages: the longest span of each, the one that spans the whole frame.
fn hand_overs<'a>(spans: &[&'a Span]) -> Vec<(&'a Span, &'a Span)> {
    let mut whole: BTreeMap<(u64, usize), &Span> = BTreeMap::new();
    for &span in spans {
        let Some(stage) = super::frame::STAGES
            .iter()
            .position(|stage| *stage == span.process)
        else {
            continue;
        };
        let longest = whole.entry((span.sequence, stage)).or_insert(span);
        if span.end_ns - span.begin_ns > longest.end_ns - longest.begin_ns {
            *longest = span;
        }
    }
    whole
        .iter()
        .filter_map(|(&(sequence, stage), &from)| Some((from, *whole.get(&(sequence, stage + 1))?)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn span(
        process: &str,
        pid: u32,
        name: &str,
        sequence: u64,
        begin_ns: u64,
        end_ns: u64,
    ) -> Span {
        Span {
            process: process.to_string(),
            pid,
            tid: 1,
            name: name.to_string(),
            sequence,
            begin_ns,
            end_ns,
        }
    }

    fn spans() -> Vec<Span> {
        vec![
            span("ingest", 10, "frame", 7, 1_000_000, 2_000_000),
            span("backbone", 11, "frame", 7, 2_050_000, 9_000_000),
            span("backbone", 11, "run", 7, 2_060_000, 8_000_000),
            span("backbone", 11, "frame", 8, 12_050_000, 19_000_000),
        ]
    }

    #[test]
    fn one_frame_is_cut_out_and_tied_together() {
        let trace = chrome_trace(&spans(), Selection::Frame(7));
        let events = trace["traceEvents"].as_array().unwrap();
        let of = |phase: &str| {
            events
                .iter()
                .filter(|e| e["ph"] == phase)
                .collect::<Vec<_>>()
        };
        assert_eq!(of("X").len(), 3);
        assert!(of("X").iter().all(|e| e["args"]["sequence"] == 7));
        assert_eq!(of("X")[0]["ts"], 0.0);
        assert_eq!(of("X")[1]["dur"], 6950.0);
        assert_eq!(of("M").len(), 4);
        let (starts, ends) = (of("s"), of("f"));
        assert_eq!((starts.len(), ends.len()), (1, 1));
        assert_eq!(
            (&starts[0]["pid"], &ends[0]["pid"]),
            (&json!(10), &json!(11))
        );
        assert_eq!(
            (&starts[0]["ts"], &ends[0]["ts"]),
            (&json!(1000.0), &json!(1050.0))
        );
        let all = chrome_trace(&spans(), Selection::All);
        assert_eq!(
            all["traceEvents"]
                .as_array()
                .unwrap()
                .iter()
                .filter(|e| e["ph"] == "X")
                .count(),
            4
        );
    }

    #[test]
    fn lines_survive_and_half_lines_do_not() {
        for span in spans() {
            let line = serde_json::to_string(&span).unwrap();
            assert_eq!(parse_span(&line), Some(span));
            assert_eq!(parse_span(&line[..line.len() / 2]), None);
        }
        assert_eq!(parse_span(""), None);
        assert_eq!(chrome_trace(&[], Selection::All)["traceEvents"], json!([]));
    }
}
