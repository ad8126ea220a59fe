//! The process shell that all stages share, and the only user of iceoryx2's ports.
//!
//! [`Instance`] names one pipeline on this machine; [`Shell`] is one process in it: it joins the instance, opens ports
//! from the table of services ([`mluc_ipc_types::Topic`]), waits, counts, reports its health, and leaves nothing behind.
//!
//! How this crate handles properties of iceoryx2 0.10. The creator of a service decides its settings, so both sides take them from one table.
//! Overflow drops the oldest message, so a dead consumer never blocks a producer. A killed process leaves files, so the last process of an
//! instance removes all files, and the first one removes what a crash left before it opens anything. A connection file of 0 bytes would hang
//! every later start, so it is removed first. The management segment would be open to every user, so this crate creates it before iceoryx2.

mod clock;
mod error;
mod frames;
mod health;
mod input;
mod instance;
mod logging;
mod manager;
mod mapping;
mod membership;
mod node;
mod output;
mod run;
mod scans;
mod shell;
mod signals;
mod stage;
mod status;
mod sweep;

pub use clock::{monotonic_ns, wall_clock_ns};
pub use error::RuntimeError;
pub use frames::Frames;
pub use health::HealthWatch;
pub use input::{Input, Message};
pub use instance::Instance;
pub use logging::{
    LOG_FORMAT_VARIABLE, LOG_FORMATS, PatientStderr, choose_log_format, log_format, log_line,
    log_to_stderr, tell_repeats,
};
pub use manager::MANAGER_VARIABLES;
pub use membership::{Claim, ClaimNote, Membership};
pub use output::{Loan, Output};
pub use run::random_run_id;
pub use scans::Scans;
pub use shell::{Next, Shell};
pub use signals::{Shutdown, prepare_signals, reload_flag};
pub use stage::{Algorithm, StageError, count_frame, finish, run_stage, stamp_published};
pub use status::StatusWatch;

pub(crate) type Ipc = iceoryx2::service::ipc::Service;

/// An element that can lie in shared memory.
pub trait Payload: bytemuck::Pod + std::fmt::Debug + iceoryx2::prelude::ZeroCopySend {}

impl<T: bytemuck::Pod + std::fmt::Debug + iceoryx2::prelude::ZeroCopySend> Payload for T {}
