//! The log of a run: `train.jsonl`, a line every few steps.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::time::Instant;

use super::error::TrainError;
use super::losses::Losses;
use super::settings::Settings;
use super::trainer::{Report, Timing};

/// Steps that one line of the log averages.
const LOG_STEPS: u64 = 20;

/// A line of `train.jsonl`: means over the steps since the last line.
#[derive(Clone, Copy, Debug, Default, serde::Serialize)]
pub struct Progress {
    /// Steps done.
    pub step: u64,
    /// Steps in all.
    pub steps: u64,
    /// Sum of the losses.
    pub loss: f64,
    /// Each.
    pub losses: Losses,
    /// Before clipping.
    pub gradient_norm: f64,
    /// Learning rate.
    pub rate: f64,
    /// Frames a second.
    pub frames_per_s: f64,
    /// Seconds left.
    pub left_s: f64,
    /// Milliseconds a step.
    pub timing_ms: Timing,
}

/// Whether nothing, or a whole line, is last: an interruption may have cut one.
fn ends_its_line(file: &mut File) -> std::io::Result<bool> {
    if file.seek(SeekFrom::End(0))? == 0 {
        return Ok(true);
    }
    file.seek(SeekFrom::End(-1))?;
    let mut last = [0];
    file.read_exact(&mut last)?;
    Ok(last == *b"\n")
}

/// The log file, and the means since its last line.
pub(super) struct Log {
    file: File,
    path: PathBuf,
    sum: Progress,
    count: u64,
    since: Instant,
    steps: u64,
    batch: usize,
    /// Seconds a step, smoothed.
    pace_s: f64,
}

impl Log {
    /// Goes on with the log of a run that has `begun`; what another run left there is moved to `train.old.jsonl`.
    pub(super) fn open(path: &Path, settings: &Settings, begun: bool) -> Result<Log, TrainError> {
        let open = || {
            if !begun && path.exists() {
                std::fs::rename(path, path.with_extension("old.jsonl"))?;
            }
            let mut options = File::options();
            let mut file = options.create(true).read(true).append(true).open(path)?;
            if !ends_its_line(&mut file)? {
                file.write_all(b"\n")?;
            }
            Ok(file)
        };
        let file = open().map_err(|cause| TrainError::Io {
            path: path.to_owned(),
            cause,
        })?;
        Ok(Log {
            file,
            path: path.to_owned(),
            sum: Progress::default(),
            count: 0,
            since: Instant::now(),
            steps: settings.steps,
            batch: settings.batch,
            pace_s: 0.0,
        })
    }

    /// A line when enough steps have come together.
    pub(super) fn add(
        &mut self,
        report: &Report,
        step: u64,
    ) -> Result<Option<Progress>, TrainError> {
        let (sum, l, t) = (&mut self.sum, &report.losses, &report.timing);
        let mut losses = *l;
        let named = sum.losses.named_mut().into_iter().zip(losses.named_mut());
        named.for_each(|((_, sum), (_, value))| *sum += *value);
        let pairs = [
            (&mut sum.loss, l.total()),
            (&mut sum.gradient_norm, report.gradient_norm),
            (&mut sum.timing_ms.wait, t.wait),
            (&mut sum.timing_ms.prepare, t.prepare),
            (&mut sum.timing_ms.forward, t.forward),
            (&mut sum.timing_ms.losses, t.losses),
            (&mut sum.timing_ms.backward, t.backward),
            (&mut sum.timing_ms.update, t.update),
        ];
        pairs.into_iter().for_each(|(sum, value)| *sum += value);
        self.count += 1;
        if !step.is_multiple_of(LOG_STEPS) && step != self.steps {
            return Ok(None);
        }
        let mut line = self.mean();
        let seconds = self.since.elapsed().as_secs_f64() / self.count as f64;
        self.pace_s = if self.pace_s == 0.0 {
            seconds
        } else {
            0.9 * self.pace_s + 0.1 * seconds
        };
        (line.step, line.steps, line.rate) = (step, self.steps, report.rate);
        line.frames_per_s = self.batch as f64 / seconds;
        line.left_s = self.pace_s * (self.steps - step) as f64;
        let failed = |cause| TrainError::Io {
            path: self.path.clone(),
            cause,
        };
        let text = serde_json::to_string(&line).map_err(|e| failed(e.into()))?;
        let text = text + "\n";
        self.file.write_all(text.as_bytes()).map_err(failed)?;
        (self.sum, self.count, self.since) = (Progress::default(), 0, Instant::now());
        Ok(Some(line))
    }

    fn mean(&self) -> Progress {
        let (s, n) = (&self.sum, self.count as f64);
        let t = &s.timing_ms;
        let mut losses = s.losses;
        losses
            .named_mut()
            .into_iter()
            .for_each(|(_, value)| *value /= n);
        Progress {
            loss: s.loss / n,
            losses,
            gradient_norm: s.gradient_norm / n,
            timing_ms: Timing {
                wait: t.wait / n,
                prepare: t.prepare / n,
                forward: t.forward / n,
                losses: t.losses / n,
                backward: t.backward / n,
                update: t.update / n,
            },
            ..*s
        }
    }
}
