//! Whether the stages behind ingest take frames: what is sent before is lost.

use mluc_ipc_types::{Object, Stage};
use mluc_runtime::{HealthWatch, Input, monotonic_ns};

/// The stages that a frame still has to pass.
const BEHIND: [Stage; 3] = [Stage::Backbone, Stage::Head, Stage::Refiner];

/// A stage of ours is heard within this time of opening its topics.
const HEARTBEAT_PATIENCE_NS: u64 = 500_000_000;

/// Watches the stages behind ingest.
pub(crate) struct DownstreamStages {
    pub(crate) watch: HealthWatch,
    /// Since when `objects` has a producer that tells no health.
    silent_since_ns: Option<u64>,
}

impl DownstreamStages {
    pub(crate) fn new(watch: HealthWatch) -> DownstreamStages {
        DownstreamStages {
            watch,
            silent_since_ns: None,
        }
    }

    /// Those that are not ready. A refiner that tells no health (somebody else's program) counts as ready when it has
    /// opened `objects` and kept silent.
    pub(crate) fn missing(&mut self, objects: &Input<Object>) -> Vec<&'static str> {
        let is_silent = self.watch.of(Stage::Refiner).is_none() && objects.producers() > 0;
        let now_ns = monotonic_ns();
        let since_ns = *self.silent_since_ns.get_or_insert(now_ns);
        if !is_silent {
            self.silent_since_ns = None;
        }
        let is_foreign = is_silent && now_ns - since_ns > HEARTBEAT_PATIENCE_NS;
        let is_ready =
            |stage: Stage| self.watch.is_ready(stage) || (stage == Stage::Refiner && is_foreign);
        let missing = BEHIND.into_iter().filter(|stage| !is_ready(*stage));
        missing.map(Stage::name).collect()
    }

    /// Processes of the stages; 0: not heard of.
    pub(crate) fn pids(&self) -> [u32; 3] {
        BEHIND.map(|stage| self.watch.of(stage).map_or(0, |health| health.pid))
    }

    /// Whether a stage has another process than at the time of `pids`: it was restarted.
    pub(crate) fn is_restarted_since(&self, pids: [u32; 3]) -> bool {
        let mut pairs = pids.into_iter().zip(self.pids());
        pairs.any(|(then, now)| then != 0 && now != 0 && then != now)
    }
}
