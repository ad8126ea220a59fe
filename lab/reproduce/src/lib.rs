//! The paper's tables with one command: simulates and trains what is missing, evaluates, reports.
//!
//! [`run`] takes the steps of a plan one by one. Every step stores its result in a file (a data set, a model, an evaluation), written completely or
//! not at all, so an interrupted run continues where it stopped, and a network trained elsewhere is used unchanged.
//!
//! Not included: the time and the machine. Figures depend only on the data, the networks and the seeds.

mod assemble;
mod combine;
mod evaluate;
mod evaluated;
mod layout;
pub mod methods;
mod options;
mod pictures;
mod plan;
mod real;
mod report;
mod run;
mod setting;
mod simulate;
mod train;

pub use options::{Options, Screen};
pub use run::run;
pub use train::{RunState, run_state};

use layout::Layout;
use setting::Setting;

/// Result of a step.
pub(crate) type Result<T, E = mluc_evaluate::EvaluateError> = std::result::Result<T, E>;
