//! Which run this process takes part in: the topic `run`, read and written.

use std::hash::{BuildHasher, RandomState};

use iceoryx2::node::Node;
use mluc_ipc_types::{FrameHeader, RunDescription, Topic};

use crate::input::{Input, InputOptions};
use crate::{Claim, Instance, Ipc, Output, RuntimeError, monotonic_ns};

/// Role of the process that describes the run: one at a time.
pub(crate) const ROLE: &str = "run";

/// An id for a new run: random, never 0.
pub fn random_run_id() -> u64 {
    // The standard library seeds each process's hashes from the kernel's random numbers.
    let id = RandomState::new().hash_one((monotonic_ns(), std::process::id()));
    id.max(1)
}

/// Follows the topic.
pub(crate) struct RunWatch {
    input: Input<RunDescription>,
    current: Option<RunDescription>,
}

impl RunWatch {
    pub(crate) fn open(node: &Node<Ipc>, instance: &Instance) -> Result<RunWatch, RuntimeError> {
        let options = InputOptions::default();
        Ok(RunWatch {
            input: Input::open(node, instance, &Topic::RUN, Topic::RUN.name, options)?,
            current: None,
        })
    }

    /// Takes a newer description. True: a new run began. What breaks the contract is left out.
    pub(crate) fn update(&mut self) -> Result<bool, RuntimeError> {
        let Some(message) = self.input.newest()? else {
            return Ok(false);
        };
        match message.elements() {
            [run] if run.checked().is_ok() => Ok(self.set(*run)),
            _ => {
                tracing::warn!("the description of the run breaks the contract: left out");
                Ok(false)
            }
        }
    }

    pub(crate) fn set(&mut self, run: RunDescription) -> bool {
        let is_new = self.current.is_none_or(|old| old.run_id != run.run_id);
        self.current = Some(run);
        is_new
    }

    pub(crate) fn current(&self) -> Option<&RunDescription> {
        self.current.as_ref()
    }

    /// 0 before one is known.
    pub(crate) fn id(&self) -> u64 {
        self.current.map_or(0, |run| run.run_id)
    }
}

/// Describes the run and hands the description to late readers.
pub(crate) struct RunWriter {
    output: Output<RunDescription>,
    _claim: Claim,
}

impl RunWriter {
    pub(crate) fn begin(
        mut output: Output<RunDescription>,
        claim: Claim,
        run: &RunDescription,
    ) -> Result<RunWriter, RuntimeError> {
        let mut header = FrameHeader::new(0, ROLE);
        (header.run_id, header.model_fingerprint) = (run.run_id, run.model_fingerprint);
        let mut loan = output.loan(&header, 1)?;
        loan.elements_mut().fill(*run);
        loan.publish()?;
        Ok(RunWriter {
            output,
            _claim: claim,
        })
    }

    /// Readers that came since the last call get the description.
    pub(crate) fn reach_late_readers(&self) -> Result<(), RuntimeError> {
        self.output.reach_late_readers()
    }
}
