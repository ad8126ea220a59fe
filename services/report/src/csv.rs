//! The table of frames: every frame that was due, a line each, times in us since the round's first frame was due.

use std::fmt::Write;

use crate::frame::{Frame, STAGES, Stamps};
use crate::{ReportError, series};

const HEAD: &str = "round,sequence,frame,phase,outcome,due_us,\
    ingest_received_us,ingest_started_us,ingest_published_us,\
    backbone_received_us,backbone_started_us,backbone_published_us,\
    head_received_us,head_started_us,head_published_us,\
    refiner_received_us,refiner_started_us,refiner_published_us,\
    arrived_us,latency_us,flags";

/// Columns before the stamps.
const FIXED: usize = 6;

/// The table as text.
pub fn write_frames(frames: &[Frame]) -> String {
    let latency_us = series(frames).latency_us;
    let mut text = format!("{HEAD}\n");
    for (frame, latency_us) in frames.iter().zip(latency_us) {
        let phase = if frame.is_warm_up {
            "warm_up"
        } else {
            "measured"
        };
        let outcome = if frame.is_out() { "out" } else { "dropped" };
        let name: String = frame
            .name
            .chars()
            .filter(|c| !",\"\n\r".contains(*c))
            .collect();
        let (round, sequence) = (frame.round, frame.sequence);
        let _ = write!(
            text,
            "{round},{sequence},{name},{phase},{outcome},{}",
            us(frame.due_ns)
        );
        for stage in 0..STAGES.len() {
            match frame.stamps {
                Some(stamps) => {
                    let own = stamps[stage];
                    for ns in [own.received_ns, own.started_ns, own.published_ns] {
                        let _ = write!(text, ",{}", us(ns));
                    }
                }
                None => text.push_str(",,,"),
            }
        }
        match frame.is_out() {
            true => {
                let _ = write!(text, ",{}", us(frame.arrived_ns));
            }
            false => text.push(','),
        }
        let _ = writeln!(text, ",{latency_us:.3},{}", frame.flags);
    }
    text
}

fn us(ns: i64) -> String {
    format!("{:.3}", ns as f64 / 1000.0)
}

/// The frames of a table that [`write_frames`] wrote.
pub fn read_frames(text: &str) -> Result<Vec<Frame>, ReportError> {
    let mut lines = text.lines();
    let head = lines.next().unwrap_or_default();
    if head != HEAD {
        return Err(ReportError::Columns {
            expected: HEAD.to_string(),
            found: head.chars().take(200).collect(),
        });
    }
    let is_filled = |(_, line): &(usize, &str)| !line.is_empty();
    lines
        .enumerate()
        .filter(is_filled)
        .map(|(index, line)| Line::new(index + 2, line)?.frame())
        .collect()
}

/// A line's cells.
struct Line<'a> {
    number: usize,
    cells: Vec<&'a str>,
}

impl<'a> Line<'a> {
    fn new(number: usize, text: &'a str) -> Result<Line<'a>, ReportError> {
        let cells: Vec<&str> = text.split(',').collect();
        if cells.len() != HEAD.split(',').count() {
            return Err(ReportError::Line {
                line: number,
                expected: "as many cells as the head has",
                found: text.chars().take(200).collect(),
            });
        }
        Ok(Line { number, cells })
    }

    fn wrong(&self, column: usize, expected: &'static str) -> ReportError {
        ReportError::Line {
            line: self.number,
            expected,
            found: self.cells[column].chars().take(40).collect(),
        }
    }

    fn ns(&self, column: usize) -> Result<i64, ReportError> {
        let us: f64 = self.cells[column]
            .parse()
            .map_err(|_| self.wrong(column, "a time in us"))?;
        match us.is_finite() && us.abs() < 1e12 {
            true => Ok((us * 1000.0).round() as i64),
            false => Err(self.wrong(column, "a time in us below 1e12")),
        }
    }

    fn word(
        &self,
        column: usize,
        words: [&str; 2],
        expected: &'static str,
    ) -> Result<bool, ReportError> {
        match self.cells[column] {
            word if word == words[0] => Ok(true),
            word if word == words[1] => Ok(false),
            _ => Err(self.wrong(column, expected)),
        }
    }

    fn frame(&self) -> Result<Frame, ReportError> {
        let is_out = self.word(4, ["out", "dropped"], "out or dropped")?;
        let arrived = FIXED + 3 * STAGES.len();
        let stamps = match is_out {
            false => None,
            true => {
                let mut stamps = [Stamps::default(); 4];
                for (stage, own) in stamps.iter_mut().enumerate() {
                    let column = FIXED + 3 * stage;
                    own.received_ns = self.ns(column)?;
                    own.started_ns = self.ns(column + 1)?;
                    own.published_ns = self.ns(column + 2)?;
                }
                Some(stamps)
            }
        };
        let count = "a whole number";
        Ok(Frame {
            round: self.cells[0].parse().map_err(|_| self.wrong(0, count))?,
            sequence: self.cells[1].parse().map_err(|_| self.wrong(1, count))?,
            name: self.cells[2].to_string(),
            is_warm_up: self.word(3, ["warm_up", "measured"], "warm_up or measured")?,
            due_ns: self.ns(5)?,
            stamps,
            arrived_ns: if is_out { self.ns(arrived)? } else { 0 },
            flags: self.cells[arrived + 2].to_string(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::testing::{dropped, frame};

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
        assert!(matches!(
            read_frames("a,b"),
            Err(ReportError::Columns { .. })
        ));
        assert!(matches!(read_frames(""), Err(ReportError::Columns { .. })));
        let short = text.trim_end().rsplit_once(',').unwrap().0.to_string();
        assert!(matches!(
            read_frames(&short),
            Err(ReportError::Line { line: 2, .. })
        ));
        for (from, to) in [
            ("measured", "hot"),
            ("out", "gone"),
            ("0.000", "soon"),
            ("0.000", "inf"),
        ] {
            let error = read_frames(&text.replace(from, to)).unwrap_err();
            assert!(
                matches!(
                    error,
                    ReportError::Line { .. } | ReportError::Columns { .. }
                ),
                "{error}"
            );
        }
    }
}
