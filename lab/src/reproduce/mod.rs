//! The paper's tables with one command: simulate what is missing, train what is missing, evaluate, report.
//!
//! [`Plan`] lists the steps; [`run`] takes them one by one. Every step leaves its outcome in a file (a data set, a model, an
//! evaluation), written whole or not at all, so a run that was interrupted goes on where it stopped, and a network that
//! was trained elsewhere is taken as it lies there.
//!
//! What it leaves out: the clock and the machine. Figures depend on the data, the networks and the seeds alone.

mod assemble;
mod audit;
mod combine;
mod error;
mod evaluate;
mod evaluated;
mod kitti;
mod layout;
mod pictures;
mod plan;
mod real;
mod rows;
mod run;
mod simulate;
mod size;
mod train;

pub use audit::{Audit, ClassCount, audit};
pub use error::ReproduceError;
pub use evaluated::{Evaluated, StoredObject};
pub use kitti::{KittiSource, Preparation};
pub use layout::Layout;
pub use plan::{Plan, Step, Work};
pub use run::{Options, Screen, run};
pub use simulate::Simulation;
pub use size::{Size, Sizes};
pub use train::{RunState, Training, run_state};

/// What the tables are made on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Setting {
    /// Simulated industrial park, all around: knowns car, pedestrian, cyclist, truck; unknown golf cart, forklift.
    SimUdi,
    /// Simulated streets, ahead: knowns car, pedestrian, cyclist; unknown van, truck.
    SimKitti,
    /// KITTI's object benchmark, where a user has it; classes as `SimKitti`.
    Kitti,
}

impl Setting {
    /// Key in `report.json`, name of its folders.
    pub fn name(self) -> &'static str {
        match self {
            Setting::SimUdi => "sim-udi",
            Setting::SimKitti => "sim-kitti",
            Setting::Kitti => "kitti",
        }
    }

    /// The trainer's name of its classes and range.
    pub fn trainer_name(self) -> &'static str {
        match self {
            Setting::SimUdi => "udi",
            Setting::SimKitti | Setting::Kitti => "kitti",
        }
    }

    /// The simulator's family; none for recorded scans.
    pub fn family(self) -> Option<crate::simulate::Family> {
        match self {
            Setting::SimUdi => Some(crate::simulate::Family::SimUdi),
            Setting::SimKitti => Some(crate::simulate::Family::SimKitti),
            Setting::Kitti => None,
        }
    }
}
