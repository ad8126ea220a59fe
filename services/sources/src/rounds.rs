//! Times of the scans of a recording that is repeated in rounds.

use smart_default::SmartDefault;

/// A longer step between stamps, one of 0 or one back is a clock that was set, or a break: one period takes its place.
const STEP_MAX_NS: u64 = 60_000_000_000;
const PERIOD_MAX_NS: u64 = 1_000_000_000;

/// Converts stamps to times after the first scan of all rounds.
#[derive(SmartDefault)]
pub(crate) struct Rounds {
    /// Stamp of the last scan of this round, ns.
    stamp_ns: Option<u64>,
    /// Its time after the first scan of all rounds, ns.
    last_ns: Option<u64>,
    /// The last step between two stamps, ns, at most [`PERIOD_MAX_NS`].
    #[default(100_000_000)]
    period_ns: u64,
}

impl Rounds {
    /// Time of a scan after the first scan of all rounds, ns.
    pub(crate) fn offset_ns(&mut self, stamp_ns: u64) -> u64 {
        let before_ns = self.stamp_ns.replace(stamp_ns);
        let mut step_ns = before_ns.map_or(0, |before_ns| stamp_ns.wrapping_sub(before_ns));
        match step_ns {
            1..STEP_MAX_NS => self.period_ns = step_ns.min(PERIOD_MAX_NS),
            _ => step_ns = self.period_ns,
        }
        let next_ns = self.last_ns.map_or(0, |last_ns| last_ns + step_ns);
        *self.last_ns.insert(next_ns)
    }

    /// Ends a round: the next one begins one period after its last scan. False: the round had no scan, so no other round would have one.
    pub(crate) fn next_round(&mut self) -> bool {
        self.stamp_ns.take().is_some()
    }
}
