//! The contract suite of the refiner: plays backbone and head to any program that stands in the refiner's place, over the
//! same shared memory as the real stages, and looks at what comes back.
//!
//! `docs/CONTRACT.md` says what a refiner must do; each [`Verdict`] here is one part of it. [`run`] judges one program,
//! [`compare_latency`] measures what a hop into and out of it costs beside another program.

mod answer;
mod cases;
mod frame;
mod latency;
mod player;
mod program;
mod report;
mod scene;
mod session;

pub use cases::case_names;
pub use latency::{HopTimes, LatencyReport, Percentiles, compare_latency};
pub use report::{Report, Verdict};
pub use session::{CommandOf, Options, run};
