//! Which run this process takes part in: the topic `run`, read and written.

use crate::{Input, error::Result, monotonic_ns, node::IpcNode};
use mluc_ipc_types::{RunDescription, Topic};
use std::hash::{BuildHasher, RandomState};

/// Role of the process that describes the run: one at a time.
pub(crate) const ROLE: &str = "run";

/// An id for a new run: random, never 0.
pub fn random_run_id() -> u64 {
    // The standard library seeds each process's hashes from the kernel's random numbers.
    RandomState::new().hash_one((monotonic_ns(), std::process::id())).max(1)
}

/// Follows the topic.
pub(crate) struct RunWatch {
    input: Input<RunDescription>,
    pub(crate) current: Option<RunDescription>,
}

impl RunWatch {
    pub(crate) fn open(node: &IpcNode) -> Result<RunWatch> {
        Ok(RunWatch {
            input: Input::open(node, &Topic::RUN, Topic::RUN.name, false)?,
            current: None,
        })
    }

    /// Takes a newer description. True: a new run began. A description that breaks the contract is ignored.
    pub(crate) fn update(&mut self) -> Result<bool> {
        let Some(message) = self.input.newest()? else {
            return Ok(false);
        };
        let before = self.id();
        match message.elements().first().map(RunDescription::checked) {
            Some(Ok(run)) => self.current = Some(*run),
            Some(Err(error)) => {
                tracing::warn!(%error, "the description of the run breaks the contract: left out")
            }
            None => tracing::warn!("the description of the run is empty: left out"),
        }
        Ok(self.id() != before)
    }

    /// The run's id; 0 before a run is known.
    pub(crate) fn id(&self) -> u64 {
        self.current.map_or(0, |run| run.run_id)
    }
}
