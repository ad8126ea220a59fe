//! The record of one frame.

/// The stages in the order a frame meets them.
pub(crate) const STAGES: [&str; 4] = ["ingest", "backbone", "head", "refiner"];
/// The topic that each stage publishes, in the order of [`STAGES`].
pub(crate) const HOPS: [&str; 4] = ["points", "features", "detections", "objects"];

/// When a stage received its input, began to compute and published, ns since the round's first frame was due.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Stamps {
    pub(crate) received_ns: i64,
    pub(crate) started_ns: i64,
    pub(crate) published_ns: i64,
}

#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct FrameRecord {
    /// Which start of the processes it belongs to, from 0.
    pub(crate) round: u32,
    pub(crate) sequence: u64,
    /// The scan's name; empty when the frame was dropped.
    pub(crate) name: String,
    pub(crate) is_warm_up: bool,
    /// When it was due, ns since the round's first frame was due.
    pub(crate) due_ns: i64,
    /// By stage, in the order of [`STAGES`]; `None`: dropped, a newer frame replaced it.
    pub(crate) stamps: Option<[Stamps; 4]>,
    /// When the consumer received the objects, on the same clock; 0: dropped.
    pub(crate) arrived_ns: i64,
    /// Names of the flags that were set, separated by spaces.
    pub(crate) flags: String,
}

impl FrameRecord {
    pub(crate) fn is_out(&self) -> bool {
        self.stamps.is_some()
    }

    pub(crate) fn published_ns(&self) -> Option<i64> {
        self.stamps.map(|stamps| stamps[3].published_ns)
    }

    /// From due until its own objects were out, us.
    pub(crate) fn delivered_us(&self) -> Option<f64> {
        Some(micros(self.published_ns()? - self.due_ns))
    }

    /// Time in the queue before a stage, us: from its input's publication (ingest: from due) to the start of computing.
    pub(crate) fn queue_us(&self, stage: usize) -> Option<f64> {
        let stamps = self.stamps?;
        let before = stage.checked_sub(1).map(|before| stamps[before]);
        let input_ns = before.map_or(self.due_ns, |before| before.published_ns);
        Some(micros(stamps[stage].started_ns - input_ns))
    }

    pub(crate) fn run_us(&self, stage: usize) -> Option<f64> {
        let own = self.stamps?[stage];
        Some(micros(own.published_ns - own.started_ns))
    }
}

pub(crate) fn measured(frames: &[FrameRecord]) -> Vec<FrameRecord> {
    frames.iter().filter(|frame| !frame.is_warm_up).cloned().collect()
}

/// Microseconds of a time difference; 0 if it is negative, as between stamps that a foreign stage left out or mixed up.
pub(crate) fn micros(ns: i64) -> f64 {
    ns.max(0) as f64 / 1000.0
}

#[cfg(test)]
pub(crate) mod testing {
    use super::*;

    /// A frame at 10 Hz whose four stages run `run_us` each after 10 us of hand-over.
    pub(crate) fn frame(sequence: u64, run_us: i64) -> FrameRecord {
        let due_ns = sequence as i64 * 100_000_000;
        let stamps = [0, 1, 2, 3].map(|stage| {
            let received_ns = due_ns + stage * (10 + run_us) * 1000 + 10_000;
            Stamps {
                received_ns,
                started_ns: received_ns,
                published_ns: received_ns + run_us * 1000,
            }
        });
        FrameRecord {
            sequence,
            name: format!("{sequence:06}"),
            due_ns,
            stamps: Some(stamps),
            arrived_ns: stamps[3].published_ns + 20_000,
            ..FrameRecord::default()
        }
    }

    pub(crate) fn dropped(sequence: u64) -> FrameRecord {
        FrameRecord { name: String::new(), stamps: None, arrived_ns: 0, ..frame(sequence, 0) }
    }
}
