//! Times of the scans of a recording that is repeated in rounds.

/// Period of a recording with a single scan.
const PERIOD_NS: u64 = 100_000_000;

/// Converts stamps to times after the first scan of all rounds.
#[derive(Default)]
pub(crate) struct Rounds {
    /// First stamp of this round, ns; `round_ns`: start of this round after the first scan of all rounds.
    first_ns: Option<u64>,
    round_ns: u64,
    /// Time of the last scan after the first scan of all rounds, ns; `period_ns`: its time after the scan before it.
    last_ns: u64,
    period_ns: u64,
}

impl Rounds {
    /// Time of a scan after the first scan of all rounds, ns.
    pub(crate) fn offset_ns(&mut self, stamp_ns: u64) -> u64 {
        let first_ns = *self.first_ns.get_or_insert(stamp_ns);
        let offset_ns = self.round_ns + stamp_ns.saturating_sub(first_ns);
        self.period_ns = offset_ns - self.last_ns.min(offset_ns);
        self.last_ns = offset_ns;
        offset_ns
    }

    /// Ends a round: the next one begins one period after its last scan. False: the round had no scan, so no other round would have one.
    pub(crate) fn next_round(&mut self) -> bool {
        let period_ns = match self.period_ns {
            0 => PERIOD_NS,
            period_ns => period_ns,
        };
        self.round_ns = self.last_ns + period_ns;
        self.first_ns.take().is_some()
    }
}
