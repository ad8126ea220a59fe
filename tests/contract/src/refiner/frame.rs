//! What the suite sends and gets.

use mluc_ipc_types::{Detection, FrameHeader, Object, Point};

/// A frame to be sent: its detections, and its points unless they shall be missing.
#[derive(Clone, Debug)]
pub(crate) struct Frame {
    /// Of the detections' message.
    pub(crate) header: FrameHeader,
    /// Of the points' message; `None`: it is never sent.
    pub(crate) points_header: Option<FrameHeader>,
    pub(crate) points: Vec<Point>,
    pub(crate) detections: Vec<Detection>,
}

/// What was sent, as it lay in shared memory.
#[derive(Clone, Debug)]
pub(crate) struct Sent {
    pub(crate) header: FrameHeader,
    pub(crate) points: usize,
    pub(crate) detections: Vec<Detection>,
}

/// What came back.
#[derive(Clone, Debug)]
pub(crate) struct Answer {
    pub(crate) header: FrameHeader,
    pub(crate) objects: Vec<Object>,
    /// The newest message of `object_points` when the objects came.
    pub(crate) indices: Option<(FrameHeader, Vec<u32>)>,
    /// CLOCK_MONOTONIC, ns.
    pub(crate) received_ns: u64,
}

impl Answer {
    /// From the end of the detections' sending, ms.
    pub(crate) fn took_ms(&self, sent: &Sent) -> f64 {
        let begun = sent.header.stages[2].published_ns;
        self.received_ns.saturating_sub(begun) as f64 * 1e-6
    }
}
