//! Latency budgets: which stage needed longer, how often, and whether this lasts. The log sums up repeated messages.

use crate::settings::Settings;
use mluc_gateway::lines::{latency_us, stage_times};
use mluc_ipc_types::{Flags, FrameHeader, Stage};

/// This many misses in a row are an error: two seconds at 10 Hz. A guess.
const LASTING: u64 = 20;
/// A miss that lasts this long is an error too, ns.
pub(super) const LASTING_NS: u64 = 2_000_000_000;
/// The counts of stages come with their heartbeats, at most this late, ns.
const HEARTBEATS_NS: u64 = 500_000_000;

/// Whether a budget is kept.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd)]
enum Severity {
    #[default]
    Kept,
    Missed,
    Lasting,
}

/// A budget that is set, and its misses.
struct Budget {
    /// `None`: end to end.
    stage: Option<Stage>,
    limit_us: u64,
    missed: u64,
    in_row: u64,
    wait: Wait,
}

/// A frame that waits in a stage, according to the counts of published frames.
#[derive(Clone, Copy, Debug, Default)]
struct Wait {
    /// Frames that the stage before and the stage had published at the last check.
    seen: [u64; 2],
    /// When a check first found that the stage before had published more and the stage had not.
    since_ns: Option<u64>,
    said: Severity,
}

/// All budgets that are set.
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
                wait: Wait::default(),
            })
        };
        Budgets(all.filter_map(budget).collect())
    }

    /// Sets the counts to 0 for a new run.
    pub(super) fn clear(&mut self) {
        self.0.iter_mut().for_each(|budget| budget.missed = 0);
    }

    /// Records a frame that came out.
    pub(super) fn record(&mut self, header: &FrameHeader) {
        let is_late = Flags(header.flags).contains(Flags::LATE);
        for budget in &mut self.0 {
            let times = budget.stage.map(|stage| stage_times(header, stage));
            let stage_us = times.map(|times| times.queue_us.saturating_add(times.run_us));
            let us = stage_us.unwrap_or_else(|| latency_us(header));
            budget.record(us, us > budget.limit_us || is_late && stage_us.is_none());
        }
    }

    /// Judges stages in which a frame waits, by the clock. `out`: frames that each stage has published. A late pipeline is a state instead.
    pub(super) fn judge(&mut self, now_ns: u64, out: [u64; 4]) {
        for budget in &mut self.0 {
            let number = budget.stage.map_or(0, |stage| stage as usize);
            if let Some(before) = number.checked_sub(1) {
                budget.judge_wait(now_ns, [out[before], out[number]]);
            }
        }
    }

    /// Number of frames for which a stage, or the whole pipeline (`None`), needed too long.
    pub(super) fn missed(&self, stage: Option<Stage>) -> u64 {
        let budget = self.0.iter().find(|budget| budget.stage == stage);
        budget.map_or(0, |budget| budget.missed)
    }
}

impl Budget {
    fn record(&mut self, us: u64, is_missed: bool) -> Severity {
        self.missed += u64::from(is_missed);
        self.in_row = (self.in_row + 1) * u64::from(is_missed);
        let (what, count) = (self.stage.map_or("end to end", Stage::name), self.in_row);
        let [ms, limit_ms] = [us, self.limit_us].map(|us| us as f64 / 1000.0);
        let text = format!("{ms} ms, {limit_ms} allowed (budget_ms)");
        if count > 0 && count.is_multiple_of(LASTING) {
            tracing::error!("budget of {what} missed by {count} frames in a row: {text}");
            Severity::Lasting
        } else if is_missed {
            tracing::warn!("budget of {what} missed: {text}");
            Severity::Missed
        } else {
            Severity::Kept
        }
    }

    /// Returns what was logged about the frame that waits in the stage. The frame counts as missed when it comes out.
    fn judge_wait(&mut self, now_ns: u64, out: [u64; 2]) -> Severity {
        let wait = &mut self.wait;
        if out[1] != wait.seen[1] {
            *wait = Wait::default();
        } else if out[0] != wait.seen[0] && out[1] > 0 {
            // Before its first frame a stage is loading, which is no miss.
            wait.since_ns.get_or_insert(now_ns);
        }
        wait.seen = out;
        let waited_ns = wait.since_ns.map_or(0, |ns| now_ns.saturating_sub(ns));
        let missed_ns = self.limit_us * 1000 + HEARTBEATS_NS;
        let verdict = if waited_ns > missed_ns + LASTING_NS {
            Severity::Lasting
        } else if waited_ns > missed_ns {
            Severity::Missed
        } else {
            Severity::Kept
        };
        if verdict > wait.said {
            wait.said = verdict;
            let (what, ms) = (self.stage.map_or("", Stage::name), waited_ns / 1_000_000);
            let limit_ms = self.limit_us as f64 / 1000.0;
            let text =
                format!("{what} publishes nothing for {ms} ms, {limit_ms} allowed (budget_ms)");
            if verdict == Severity::Lasting {
                tracing::error!("budget missed: {text}");
            } else {
                tracing::warn!("budget missed: {text}");
            }
        }
        wait.said
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn misses_are_counted_where_a_budget_is_set() {
        let mut settings = Settings { budget_ms: Some(100), ..Settings::default() };
        settings.stages.head.budget_ms = Some(10);
        let mut budgets = Budgets::new(&settings);
        let mut header = FrameHeader::new(0, "a");
        header.stages[Stage::Refiner as usize].published_ns = 90_000_000;
        // Waiting and computing both count. In the last case the refiner has flagged the frame as late.
        let none = Flags::default();
        for (waited_ms, flags) in [(4, none), (5, none), (5, Flags::LATE)] {
            let head = &mut header.stages[Stage::Head as usize];
            head.started_ns = waited_ms * 1_000_000;
            head.published_ns = head.started_ns + 6_000_000;
            header.flag(flags);
            budgets.record(&header);
        }
        for number in 3..=LASTING {
            let verdict = budgets.0[0].record(11_000, true);
            let is_last = number == LASTING;
            assert_eq!(verdict == Severity::Lasting, is_last, "{number}");
        }
        let missed = [Some(Stage::Head), None, Some(Stage::Refiner)].map(|s| budgets.missed(s));
        assert_eq!((missed, budgets.0[0].in_row), ([20, 1, 0], 20));
        assert_eq!(budgets.0[0].record(1, false), Severity::Kept);
    }

    #[test]
    fn a_stage_that_stops_misses_its_budget_by_the_clock() {
        let mut settings = Settings::default();
        settings.stages.head.budget_ms = Some(100);
        let mut budgets = Budgets::new(&settings);
        let head = &mut budgets.0[0];
        // Time in ms, frames published by the backbone and by the head.
        for (ms, out, expected) in [
            (0, [1, 0], Severity::Kept),
            (9_000, [1, 0], Severity::Kept),
            (9_010, [1, 1], Severity::Kept),
            (20_000, [1, 1], Severity::Kept),
            (20_010, [2, 1], Severity::Kept),
            (20_600, [3, 1], Severity::Kept),
            (20_620, [4, 1], Severity::Missed),
            (22_700, [4, 1], Severity::Lasting),
            (22_710, [4, 2], Severity::Kept),
            (60_000, [4, 2], Severity::Kept),
        ] {
            let found = head.judge_wait(ms * 1_000_000, out);
            assert_eq!(found, expected, "{ms} ms");
        }
    }
}
