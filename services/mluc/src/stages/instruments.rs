//! How a frame's way through a stage is told: stamps in its header, always on, and spans, written when somebody traces.

use std::sync::OnceLock;

use mluc_ipc_types::FrameHeader;
use tracing::span::EnteredSpan;

/// Of the spans that [`mluc_runtime::log_to_stderr`] writes.
pub(crate) const SPANS: &str = "mluc::frame";

/// Switches off what `mluc bench` compares against: `off` leaves only the stamps that the latency end to end needs.
pub(crate) const STAMPS_VARIABLE: &str = "MLUC_STAMPS";

/// Whether the stages stamp their own times.
pub(super) fn stamps_are_on() -> bool {
    static ON: OnceLock<bool> = OnceLock::new();
    *ON.get_or_init(|| std::env::var(STAMPS_VARIABLE).as_deref() != Ok("off"))
}

/// From taking a frame to having published it.
pub(super) fn frame_span(header: &FrameHeader) -> EnteredSpan {
    tracing::trace_span!(target: SPANS, "frame", sequence = header.sequence).entered()
}

/// The stage's own work on the frame.
pub(super) fn run_span<T>(work: impl FnOnce() -> T) -> T {
    tracing::trace_span!(target: SPANS, "run").in_scope(work)
}
