//! Latency budgets: who needed longer, how often, and whether it lasts. The log sums up what repeats.

use mluc_gateway::lines::{latency_us, stage_times};
use mluc_ipc_types::{Flags, FrameHeader, Stage};

use crate::settings::Settings;

/// Misses in a row that are an error: two seconds at 10 Hz. A guess.
const LASTING: u64 = 20;

/// A budget that is set, and its misses.
struct Budget {
    /// `None`: end to end.
    stage: Option<Stage>,
    limit_us: u64,
    missed: u64,
    in_row: u64,
}

/// All that are set.
pub(super) struct Budgets(Vec<Budget>);

impl Budgets {
    pub(super) fn new(settings: &Settings) -> Budgets {
        let of_stages = Stage::ALL.map(|stage| (Some(stage), settings.stages[stage].budget_ms));
        let all = of_stages.into_iter().chain([(None, settings.budget_ms)]);
        let budget = |(stage, limit_ms): (Option<Stage>, Option<u64>)| {
            Some(Budget {
                stage,
                limit_us: limit_ms? * 1000,
                missed: 0,
                in_row: 0,
            })
        };
        Budgets(all.filter_map(budget).collect())
    }

    /// A frame that came out.
    pub(super) fn record(&mut self, header: &FrameHeader) {
        let is_late = Flags(header.flags).contains(Flags::LATE);
        for budget in &mut self.0 {
            let times = budget.stage.map(|stage| stage_times(header, stage));
            let stage_us = times.map(|times| times.queue_us.saturating_add(times.run_us));
            let us = stage_us.unwrap_or_else(|| latency_us(header));
            budget.record(us, us > budget.limit_us || is_late && stage_us.is_none());
        }
    }

    /// Frames that a stage, or the whole way, needed too long for.
    pub(super) fn missed(&self, stage: Option<Stage>) -> u64 {
        let budget = self.0.iter().find(|budget| budget.stage == stage);
        budget.map_or(0, |budget| budget.missed)
    }
}

impl Budget {
    fn record(&mut self, us: u64, is_missed: bool) {
        self.missed += u64::from(is_missed);
        self.in_row = (self.in_row + 1) * u64::from(is_missed);
        let (what, count) = (self.stage.map_or("end to end", Stage::name), self.in_row);
        let [ms, limit_ms] = [us, self.limit_us].map(|us| us as f64 / 1000.0);
        let text = format!("{ms} ms, {limit_ms} allowed (budget_ms)");
        if count > 0 && count.is_multiple_of(LASTING) {
            tracing::error!("budget of {what} missed by {count} frames in a row: {text}");
        } else if is_missed {
            tracing::warn!("budget of {what} missed: {text}");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn misses_are_counted_where_a_budget_is_set() {
        let mut settings = Settings {
            budget_ms: Some(100),
            ..Settings::default()
        };
        settings.stages.head.budget_ms = Some(10);
        let mut budgets = Budgets::new(&settings);
        let mut header = FrameHeader::new(0, "a");
        header.stages[Stage::Refiner as usize].published_ns = 90_000_000;
        // Waiting and computing; the refiner knows that it was late.
        for (waited_ms, flags) in [
            (4, Flags::default()),
            (5, Flags::default()),
            (5, Flags::LATE),
        ] {
            let head = &mut header.stages[Stage::Head as usize];
            head.started_ns = waited_ms * 1_000_000;
            head.published_ns = head.started_ns + 6_000_000;
            header.flag(flags);
            budgets.record(&header);
        }
        let missed = [Some(Stage::Head), None, Some(Stage::Refiner)].map(|s| budgets.missed(s));
        assert_eq!((missed, budgets.0[0].in_row), ([2, 1, 0], 2));
    }
}
