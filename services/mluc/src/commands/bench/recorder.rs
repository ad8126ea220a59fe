//! Notes every frame that comes out, and looks at the processes meanwhile.

use std::time::{Duration, Instant};

use anyhow::bail;
use mluc_ipc_types::{FrameHeader, Object, Stage};
use mluc_runtime::{HealthWatch, monotonic_ns};

use super::processes::ProcessWatch;
use super::progress::Progress;
use super::quality::Boxes;
use crate::supervisor::Sink;

/// A frame as it arrived.
#[derive(Clone, Copy)]
pub(super) struct Arrival {
    pub(super) header: FrameHeader,
    pub(super) at_ns: u64,
}

/// What a round is to be measured with.
pub(super) struct Recorder<'a> {
    pub(super) arrivals: Vec<Arrival>,
    /// By the scan's name, the first time that it came: the pipeline is deterministic.
    pub(super) boxes: Vec<(String, Boxes)>,
    pub(super) watch: ProcessWatch,
    /// Payload bytes of each stage's last message.
    pub(super) payload_bytes: [u64; 4],
    /// What a foreign stage does not tell and our own do: whether it was heard of.
    pub(super) is_heard: [bool; 4],
    warm_up_s: f64,
    end_s: f64,
    patience: Duration,
    begun: Instant,
    progress: &'a mut Progress,
    what: String,
}

impl<'a> Recorder<'a> {
    /// `end_s`: when the round's last frame is due, for the bar.
    pub(super) fn new(
        warm_up_s: f64,
        end_s: f64,
        patience: Duration,
        progress: &'a mut Progress,
        what: String,
    ) -> Recorder<'a> {
        Recorder {
            arrivals: Vec::new(),
            boxes: Vec::new(),
            watch: ProcessWatch::default(),
            payload_bytes: [0; 4],
            is_heard: [false; 4],
            warm_up_s,
            end_s,
            patience,
            begun: Instant::now(),
            progress,
            what,
        }
    }

    /// Since the first frame was due, by the first one that came.
    fn at_s(&self) -> Option<f64> {
        let first = self.arrivals.first()?;
        let due_ns = first.header.stages[Stage::Ingest as usize].received_ns;
        Some((monotonic_ns() as f64 - due_ns as f64) * 1e-9)
    }

    fn give_up(&self, health: &HealthWatch) -> anyhow::Result<bool> {
        let words: Vec<String> = Stage::ALL
            .iter()
            .map(|&stage| describe(stage, health))
            .collect();
        bail!(
            "no objects came within {} s of the start: {}",
            self.patience.as_secs_f64(),
            words.join("; ")
        )
    }
}

fn describe(stage: Stage, health: &HealthWatch) -> String {
    let name = stage.name();
    match health
        .of(stage)
        .and_then(|health| Some((health, health.checked().ok()?.1)))
    {
        None => format!("{name} is silent"),
        Some((health, state)) if health.reason().is_empty() => format!("{name}: {}", state.name()),
        Some((health, state)) => format!("{name}: {} ({})", state.name(), health.reason()),
    }
}

impl Sink for Recorder<'_> {
    fn frame(
        &mut self,
        header: &FrameHeader,
        objects: &[Object],
        _classes: &[String],
    ) -> anyhow::Result<bool> {
        let at_ns = monotonic_ns();
        self.arrivals.push(Arrival {
            header: *header,
            at_ns,
        });
        if self.boxes.iter().all(|(name, _)| name != header.name()) {
            self.boxes
                .push((header.name().to_string(), Boxes::of(objects)));
        }
        Ok(true)
    }

    fn look(&mut self, health: &HealthWatch, processes: [u32; 4]) -> anyhow::Result<bool> {
        for stage in Stage::ALL {
            if let Some(health) = health.of(stage) {
                self.payload_bytes[stage as usize] = u64::from(health.bytes_written);
                self.is_heard[stage as usize] = true;
            }
        }
        let Some(at_s) = self.at_s() else {
            self.progress.show(0.0, &format!("{}: starting", self.what));
            return match self.begun.elapsed() > self.patience {
                true => self.give_up(health),
                false => Ok(true),
            };
        };
        self.watch.look(at_s, at_s >= self.warm_up_s, processes);
        let text = format!(
            "{}: {:.0} of {:.0} s, {} frames",
            self.what,
            at_s.min(self.end_s),
            self.end_s,
            self.arrivals.len()
        );
        self.progress.show(at_s / self.end_s, &text);
        Ok(true)
    }
}
