//! What every stage does around a frame: stamps, counters, refusals.

use mluc_ipc_types::{ContractError, FrameHeader, HealthState, Stage};
use mluc_runtime::{RuntimeError, Shell, monotonic_ns};

use super::instruments::stamps_are_on;

/// Begins a frame: the header that goes on, with this stage's first two stamps.
pub(crate) fn begin(stage: Stage, header: &FrameHeader, received_ns: u64) -> FrameHeader {
    let mut header = *header;
    if stamps_are_on() {
        let stamps = header.stamps_mut(stage);
        stamps.received_ns = received_ns;
        stamps.started_ns = monotonic_ns();
    }
    header
}

/// The last stamp, right before the message is handed over. The refiner's ends the frame: it is always there.
pub(crate) fn stamp_published(stage: Stage, header: &mut FrameHeader) {
    if stamps_are_on() || stage == Stage::Refiner {
        header.stamps_mut(stage).published_ns = monotonic_ns();
    }
}

/// A frame left: counts it and its time.
pub(crate) fn finish(
    shell: &mut Shell,
    stage: Stage,
    header: &FrameHeader,
) -> Result<(), RuntimeError> {
    let stamps = header.stages[stage as usize];
    if stamps_are_on() {
        shell.record_run(monotonic_ns().saturating_sub(stamps.started_ns));
    }
    shell.counters.frames_out += 1;
    shell.state(HealthState::Running, "")?;
    shell.tick()
}

/// Refuses a message that breaks the contract or comes of another model.
pub(crate) fn refuse(shell: &mut Shell, why: &str) -> Result<(), RuntimeError> {
    shell.refuse(why)
}

/// Whether the frame was made for this stage's model; 0 is a sender that does not say.
pub(crate) fn check_model(header: &FrameHeader, fingerprint: u64) -> Result<(), ContractError> {
    match header.model_fingerprint {
        0 => Ok(()),
        found if found == fingerprint => Ok(()),
        found => Err(ContractError::Mismatch {
            what: "fingerprint of the model (both sides must run the same model)",
            expected: fingerprint,
            found,
        }),
    }
}
