//! The table of frames: one line per frame that was due, times in us since the round's first frame was due.

use super::{frame::FrameRecord, frame::Stamps, series::series};
use anyhow::{Context, Result, ensure};
use std::str::FromStr;

const HEAD: &str = "round,sequence,frame,phase,outcome,due_us,\
    ingest_received_us,ingest_started_us,ingest_published_us,\
    backbone_received_us,backbone_started_us,backbone_published_us,\
    head_received_us,head_started_us,head_published_us,\
    refiner_received_us,refiner_started_us,refiner_published_us,\
    arrived_us,latency_us,flags";

const PHASES: [&str; 2] = ["warm_up", "measured"];
const OUTCOMES: [&str; 2] = ["out", "dropped"];
/// Number of columns before the stamps, and including the stamps.
const FIXED: usize = 6;
const ARRIVED: usize = FIXED + 12;

pub(crate) fn write_frames(frames: &[FrameRecord]) -> String {
    let latency_us = series(frames).latency_us;
    let mut text = format!("{HEAD}\n");
    let us = |ns: i64| format!(",{:.3}", ns as f64 / 1000.0);
    let own_us = |own: Stamps| [own.received_ns, own.started_ns, own.published_ns].map(us).concat();
    for (frame, latency_us) in frames.iter().zip(latency_us) {
        let (round, sequence, flags) = (frame.round, frame.sequence, &frame.flags);
        let name = frame.name.replace([',', '"', '\n', '\r'], "");
        let phase = PHASES[usize::from(!frame.is_warm_up)];
        let outcome = OUTCOMES[usize::from(!frame.is_out())];
        let due = us(frame.due_ns);
        let times = frame
            .stamps
            .map_or(",".repeat(13), |stamps| stamps.map(own_us).concat() + &us(frame.arrived_ns));
        text += &format!(
            "{round},{sequence},{name},{phase},{outcome}{due}{times},{latency_us:.3},{flags}\n"
        );
    }
    text
}

/// The frames of a table that [`write_frames`] wrote.
pub(crate) fn read_frames(text: &str) -> Result<Vec<FrameRecord>> {
    let head = text.lines().next().unwrap_or_default();
    ensure!(head == HEAD, "frames.csv: expected the columns `{HEAD}`, found `{head:.200}`");
    let lines = text.lines().zip(1..).skip(1);
    let read = |(line, number): (&str, usize)| {
        read_frame(line).with_context(|| format!("frames.csv, line {number}"))
    };
    lines.filter(|line| !line.0.is_empty()).map(read).collect()
}

fn read_frame(line: &str) -> Result<FrameRecord> {
    let cells: Vec<&str> = line.split(',').collect();
    let (expected, found) = (HEAD.split(',').count(), cells.len());
    ensure!(found == expected, "expected {expected} cells, found {found}");
    let ns = |column: usize| -> Result<i64> {
        let us: f64 = number(cells[column])?;
        ensure!(us.abs() < 1e12, "expected a time in us below 1e12, found `{us}`");
        Ok((us * 1000.0).round() as i64)
    };
    let is_out = is_first(cells[4], OUTCOMES)?;
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
        is_warm_up: is_first(cells[3], PHASES)?,
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

fn is_first(cell: &str, [first, second]: [&str; 2]) -> Result<bool> {
    let wrong = || format!("expected {first} or {second}, found `{cell:.40}`");
    [first, second].contains(&cell).then_some(cell == first).with_context(wrong)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::frame::testing::{dropped, frame};

    #[test]
    fn what_is_written_is_read() {
        let mut frames = vec![frame(0, 900), dropped(1), frame(2, 1000)];
        (frames[0].is_warm_up, frames[2].round) = (true, 3);
        frames[2].flags = "late resent".to_string();
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
        let damages = [(",measured,", ",hot,"), (",out,", ",gone,")];
        let times = ["soon", "inf"].map(|time| ("0.000", time));
        for (from, to) in damages.into_iter().chain(times) {
            let error = error(&text.replace(from, to));
            assert!(error.contains("line 2: expected"), "{error}");
        }
    }
}
