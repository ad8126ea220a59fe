//! The table of frames: every frame that was due, a line each, times in us since the round's first frame was due.

use std::fmt::Write;
use std::str::FromStr;

use anyhow::{Context, Result, bail, ensure};

use super::frame::{FrameRecord, Stamps};
use super::series::series;

const HEAD: &str = "round,sequence,frame,phase,outcome,due_us,\
    ingest_received_us,ingest_started_us,ingest_published_us,\
    backbone_received_us,backbone_started_us,backbone_published_us,\
    head_received_us,head_started_us,head_published_us,\
    refiner_received_us,refiner_started_us,refiner_published_us,\
    arrived_us,latency_us,flags";

/// Columns before the stamps, and with them.
const FIXED: usize = 6;
const ARRIVED: usize = FIXED + 12;

/// The table as text.
pub fn write_frames(frames: &[FrameRecord]) -> String {
    let latency_us = series(frames).latency_us;
    let mut text = format!("{HEAD}\n");
    let us = |ns: i64| format!(",{:.3}", ns as f64 / 1000.0);
    for (frame, latency_us) in frames.iter().zip(latency_us) {
        let phase = if frame.is_warm_up {
            "warm_up"
        } else {
            "measured"
        };
        let outcome = if frame.is_out() { "out" } else { "dropped" };
        let name = frame.name.replace([',', '"', '\n', '\r'], "");
        let (round, sequence) = (frame.round, frame.sequence);
        let due = us(frame.due_ns);
        let times = frame.stamps.map_or(",".repeat(13), |stamps| {
            let each = stamps.map(|own| {
                [own.received_ns, own.started_ns, own.published_ns]
                    .map(us)
                    .concat()
            });
            each.concat() + &us(frame.arrived_ns)
        });
        let flags = &frame.flags;
        let _ = writeln!(
            text,
            "{round},{sequence},{name},{phase},{outcome}{due}{times},{latency_us:.3},{flags}"
        );
    }
    text
}

/// The frames of a table that [`write_frames`] wrote.
pub fn read_frames(text: &str) -> Result<Vec<FrameRecord>> {
    let head = text.lines().next().unwrap_or_default();
    if head != HEAD {
        let found: String = head.chars().take(200).collect();
        bail!("frames.csv: expected the columns `{HEAD}`, found `{found}`");
    }
    let lines = text.lines().enumerate().skip(1);
    lines
        .filter(|(_, line)| !line.is_empty())
        .map(|(index, line)| {
            read_frame(line).with_context(|| format!("frames.csv, line {}", index + 1))
        })
        .collect()
}

fn read_frame(line: &str) -> Result<FrameRecord> {
    let cells: Vec<&str> = line.split(',').collect();
    let expected = HEAD.split(',').count();
    ensure!(
        cells.len() == expected,
        "expected {expected} cells, found {}",
        cells.len()
    );
    let ns = |column: usize| -> Result<i64> {
        let us: f64 = number(cells[column])?;
        ensure!(
            us.abs() < 1e12,
            "expected a time in us below 1e12, found `{us}`"
        );
        Ok((us * 1000.0).round() as i64)
    };
    let is_out = is_first(cells[4], ["out", "dropped"])?;
    let mut stamps = [Stamps::default(); 4];
    for (stage, own) in stamps.iter_mut().enumerate().filter(|_| is_out) {
        let column = FIXED + 3 * stage;
        own.received_ns = ns(column)?;
        own.started_ns = ns(column + 1)?;
        own.published_ns = ns(column + 2)?;
    }
    Ok(FrameRecord {
        round: number(cells[0])?,
        sequence: number(cells[1])?,
        name: cells[2].to_string(),
        is_warm_up: is_first(cells[3], ["warm_up", "measured"])?,
        due_ns: ns(5)?,
        stamps: is_out.then_some(stamps),
        arrived_ns: if is_out { ns(ARRIVED)? } else { 0 },
        flags: cells[ARRIVED + 2].to_string(),
    })
}

fn number<T: FromStr>(cell: &str) -> Result<T> {
    let wrong = || format!("expected a number, found `{cell:.40}`");
    cell.parse().ok().with_context(wrong)
}

fn is_first(cell: &str, words: [&str; 2]) -> Result<bool> {
    let [first, second] = words;
    ensure!(
        words.contains(&cell),
        "expected {first} or {second}, found `{cell:.40}`"
    );
    Ok(cell == first)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::frame::testing::{dropped, frame};

    #[test]
    fn what_is_written_is_read() {
        let mut frames = vec![frame(0, 900), dropped(1), frame(2, 1000)];
        frames[0].is_warm_up = true;
        frames[2].flags = "late resent".to_string();
        frames[2].round = 3;
        assert_eq!(read_frames(&write_frames(&frames)).unwrap(), frames);
    }

    #[test]
    fn damage_is_named() {
        let text = write_frames(&[frame(0, 900)]);
        let error = |text: &str| format!("{:#}", read_frames(text).unwrap_err());
        for head in ["a,b", ""] {
            assert!(error(head).contains("expected the columns"));
        }
        let short = text.trim_end().rsplit_once(',').unwrap().0;
        assert!(error(short).contains("line 2: expected 21 cells, found 20"));
        for (from, to) in [
            (",measured,", ",hot,"),
            (",out,", ",gone,"),
            ("0.000", "soon"),
            ("0.000", "inf"),
        ] {
            let error = error(&text.replace(from, to));
            assert!(error.contains("line 2: expected"), "{error}");
        }
    }
}
