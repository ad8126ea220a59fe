//! Whether the stages behind ingest take frames: what is sent before is lost.

use mluc_ipc_types::{Object, Stage};
use mluc_runtime::{HealthWatch, Input, RuntimeError};

/// The stages that a frame still has to pass.
const BEHIND: [Stage; 3] = [Stage::Backbone, Stage::Head, Stage::Refiner];

/// Watches the stages behind ingest.
pub(crate) struct Followers {
    watch: HealthWatch,
}

impl Followers {
    pub(crate) fn new(watch: HealthWatch) -> Followers {
        Followers { watch }
    }

    pub(crate) fn update(&mut self) -> Result<(), RuntimeError> {
        self.watch.update().map(|_| ())
    }

    /// Those that are not ready. A refiner that tells no health (somebody else's program) counts as ready when it has
    /// opened `objects`.
    pub(crate) fn missing(&self, objects: &Input<Object>) -> Vec<&'static str> {
        let is_ready = |&stage: &Stage| match self.watch.of(stage) {
            None if stage == Stage::Refiner => objects.producers() > 0,
            _ => self.watch.is_ready(stage),
        };
        BEHIND
            .iter()
            .filter(|stage| !is_ready(stage))
            .map(|stage| stage.name())
            .collect()
    }

    /// Tells two lives of the stages apart: a stage that was restarted has another process.
    pub(crate) fn lives(&self) -> [u32; 3] {
        BEHIND.map(|stage| self.watch.of(stage).map_or(0, |health| health.pid))
    }
}
