//! When the scans of a recording come, over one round of it after the other.

/// Of a recording with a single scan.
const PERIOD_NS: u64 = 100_000_000;

/// Stamps to times after the first scan of all rounds.
#[derive(Default)]
pub(crate) struct Rounds {
    /// This round's first stamp, ns, and when the round began after the first one.
    first_ns: Option<u64>,
    round_ns: u64,
    /// When the last scan came after the first one of all, and how long after the one before it, ns.
    last_ns: u64,
    period_ns: u64,
}

impl Rounds {
    /// When a scan comes after the first one of all, ns.
    pub(crate) fn offset_ns(&mut self, stamp_ns: u64) -> u64 {
        let first_ns = *self.first_ns.get_or_insert(stamp_ns);
        let offset_ns = self.round_ns + stamp_ns.saturating_sub(first_ns);
        self.period_ns = offset_ns - self.last_ns.min(offset_ns);
        self.last_ns = offset_ns;
        offset_ns
    }

    /// A round ended: the next one begins one period after its last scan. False: it had no scan, and no other would have one.
    pub(crate) fn next_round(&mut self) -> bool {
        let period_ns = match self.period_ns {
            0 => PERIOD_NS,
            period_ns => period_ns,
        };
        self.round_ns = self.last_ns + period_ns;
        self.first_ns.take().is_some()
    }
}
