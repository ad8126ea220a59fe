//! The log of a run: `train.jsonl`, one line every few steps.

use crate::{error::TrainError, losses::Losses, settings::TrainSettings};
use std::{fs::File, io::Write, path::PathBuf, time::Instant};

/// Number of steps averaged in one line of the log.
const LOG_STEPS: u64 = 20;

/// Events reported during a run.
pub enum TrainEvent<'a> {
    /// A message for the user.
    Note(String),
    /// A line of the log.
    Progress(&'a Progress),
}

/// A line of `train.jsonl`: means over the steps since the last line.
#[derive(Clone, Copy, Debug, Default, serde::Serialize)]
pub struct Progress {
    /// Number of steps done.
    pub step: u64,
    /// Total number of steps.
    pub steps: u64,
    /// Sum of the losses.
    pub loss: f64,
    /// Each loss.
    pub losses: Losses,
    /// Norm of the gradient before clipping.
    pub gradient_norm: f64,
    /// Learning rate of the last step.
    pub rate: f64,
    /// Frames per second.
    pub frames_per_s: f64,
    /// Seconds left.
    pub left_s: f64,
}

impl Progress {
    /// The values that are averaged.
    fn means_mut(&mut self) -> impl Iterator<Item = &mut f64> {
        let losses = self.losses.named_mut().into_iter().map(|(_, value)| value);
        losses.chain([&mut self.loss, &mut self.gradient_norm])
    }
}

/// The log file, and the sums since its last line.
pub(crate) struct Log {
    file: File,
    path: PathBuf,
    sum: Progress,
    count: u64,
    since: Instant,
    steps: u64,
    batch: usize,
    /// Seconds per step, smoothed.
    pace_s: Option<f64>,
}

impl Log {
    /// Continues the log of a run that has `begun`; otherwise an existing log is moved to `train.old.jsonl`.
    pub(crate) fn open(settings: &TrainSettings, begun: bool) -> Result<Log, TrainError> {
        let path = settings.out.join("train.jsonl");
        let open = || {
            if !begun && path.exists() {
                std::fs::rename(&path, path.with_extension("old.jsonl"))?;
            }
            let mut file = File::options().create(true).append(true).open(&path)?;
            // An interruption may have truncated the last line.
            let is_cut = std::fs::read(&path)?.last().is_some_and(|last| *last != b'\n');
            if is_cut {
                file.write_all(b"\n")?;
            }
            Ok(file)
        };
        Ok(Log {
            file: open().map_err(|cause: std::io::Error| TrainError::file(&path, cause))?,
            path,
            sum: Progress::default(),
            count: 0,
            since: Instant::now(),
            steps: settings.steps,
            batch: settings.batch,
            pace_s: None,
        })
    }

    /// Adds a step; returns a line after enough steps.
    pub(crate) fn add(&mut self, mut step: Progress) -> Result<Option<Progress>, TrainError> {
        let (done, rate) = (step.step, step.rate);
        self.sum.means_mut().zip(step.means_mut()).for_each(|(sum, value)| *sum += *value);
        self.count += 1;
        if !done.is_multiple_of(LOG_STEPS) && done != self.steps {
            return Ok(None);
        }
        let mut line = std::mem::take(&mut self.sum);
        let count = self.count as f64;
        line.means_mut().for_each(|value| *value /= count);
        let seconds = self.since.elapsed().as_secs_f64() / count;
        let smooth = |pace| 0.9 * pace + 0.1 * seconds;
        let pace_s = self.pace_s.map_or(seconds, smooth);
        (line.step, line.steps, line.rate) = (done, self.steps, rate);
        line.frames_per_s = self.batch as f64 / seconds;
        line.left_s = pace_s * (self.steps - done) as f64;
        let failed = |cause: std::io::Error| TrainError::file(&self.path, cause);
        let text = serde_json::to_string(&line).map_err(|e| failed(e.into()))?;
        let text = text + "\n";
        self.file.write_all(text.as_bytes()).map_err(failed)?;
        (self.pace_s, self.count, self.since) = (Some(pace_s), 0, Instant::now());
        Ok(Some(line))
    }
}
