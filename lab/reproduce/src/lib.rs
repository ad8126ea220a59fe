//! The paper's tables with one command: simulate what is missing, train what is missing, evaluate, report.
//!
//! [`run`] takes the steps of a plan one by one. Every step leaves its outcome in a file (a data set, a model, an evaluation), written whole or not at all, so
//! a run that was interrupted goes on where it stopped, and a network that was trained elsewhere is taken as it is.
//!
//! What it leaves out: the clock and the machine. Figures depend on the data, the networks and the seeds alone.

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
use setting::{Setting, Size};

/// A step's outcome.
pub(crate) type Result<T, E = mluc_evaluate::EvaluateError> = std::result::Result<T, E>;
