//! The current state of the pipeline, judged by a clock and not by messages, so that a stopped pipeline is reported too.

use super::{Outcome, budget::Budgets, budget::LASTING_NS};
use crate::settings::Settings;
use mluc_gateway::lines::latency_us;
use mluc_ingest::estimate::View;
use mluc_ipc_types::{
    Flags, FrameHeader, HealthState, Point, RunDescription, Stage, Status, StatusState, Text,
    Topic, WIRE_VERSION,
};
use mluc_model::SensorProfile;
use mluc_runtime::{HealthWatch, Message, Output, RuntimeError, Shell, monotonic_ns};

/// Time between two messages while nothing changes, ns.
const PERIOD_NS: u64 = 500_000_000;
/// Time between two checks of what the sensor sees, ns.
const LOOK_NS: u64 = 250_000_000;
/// A better state must last this long before it is shown, ns.
const HOLD_NS: u64 = 500_000_000;
/// A run without a result for this long has stopped, ns.
const START_MAX_NS: u64 = 30_000_000_000;
/// The longest period of a sensor that is not known to be slower, by its configured rate or the run's first scans, ns.
const PERIOD_MAX_NS: u64 = 1_000_000_000;
/// The sensor's period, ns, that is assumed before two scans came.
const PERIOD_UNKNOWN_NS: u64 = 1_000_000_000;
/// Results this much older (ns) than the limit for late are no longer expected; a stage without a heartbeat for this long is silent.
const SILENCE_NS: u64 = Topic::SILENCE_MAX.as_nanos() as u64;
/// A scan with a larger share of points that are not finite is unusable. With drivers that write such points, half of a scan is sky.
const NOT_FINITE_MAX: f32 = 0.9;
/// Flags of a result of reduced quality; the flags that say why the input is suspect count too.
const COMPLAINTS: [&str; 5] =
    ["input_suspect", "damaged_input", "truncated", "points_gone", "degraded"];

type Verdict = (StatusState, String);

/// Judges the state of the pipeline and publishes it.
pub(super) struct StatusWriter {
    output: Output<Status>,
    view: View,
    looked_ns: u64,
    facts: Facts,
    budgets: Budgets,
    counts: StageCounts,
    run_id: u64,
    shown: Verdict,
    /// Since when the state has not changed, ns; `u64::MAX`: its duration was already reported.
    state_since_ns: u64,
    /// Since when every judgement was better than what is shown.
    better_since_ns: Option<u64>,
    published: Status,
    /// The status at the last tick.
    pub(super) current: Status,
}

impl StatusWriter {
    pub(super) fn open(
        shell: &mut Shell,
        settings: &Settings,
        sensor: Option<&SensorProfile>,
    ) -> Result<StatusWriter, RuntimeError> {
        Ok(StatusWriter {
            output: shell.output(&Topic::STATUS, 1)?,
            view: View::new(sensor),
            looked_ns: 0,
            facts: Facts {
                budget_ns: settings.budget_ms.map(|ms| ms * 1_000_000),
                begun_ns: monotonic_ns(),
                period_ns: settings.rate_hz.map_or(0, |rate_hz| (1e9 / rate_hz) as u64),
                ..Facts::default()
            },
            budgets: Budgets::new(settings),
            counts: StageCounts::default(),
            run_id: 0,
            shown: (StatusState::Starting, String::new()),
            state_since_ns: 0,
            better_since_ns: None,
            published: Status::default(),
            current: Status::default(),
        })
    }

    /// Discards what the last run saw when a new run begins.
    fn follow(&mut self, run: &RunDescription) {
        if self.run_id != run.run_id {
            self.run_id = run.run_id;
            self.view.clear();
            self.budgets.clear();
            self.counts = StageCounts::default();
            self.facts = Facts {
                budget_ns: self.facts.budget_ns,
                begun_ns: monotonic_ns(),
                period_ns: self.facts.period_ns,
                ..Facts::default()
            };
        }
    }

    /// Takes a scan that ingest has sent.
    pub(super) fn see(&mut self, run: &RunDescription, scan: &Message<Point>) {
        self.follow(run);
        let header = scan.header();
        self.facts.take_scan(header);
        let now_ns = monotonic_ns();
        if now_ns - self.looked_ns < LOOK_NS {
            return;
        }
        self.looked_ns = now_ns;
        let points = Point::checked(header, scan.elements()).unwrap_or_default();
        self.view.look(points);
        let [expected, blind] = [self.view.expected(), self.view.blind()];
        (self.facts.expected_sectors, self.facts.blind_sectors) = (expected, blind);
        self.facts.is_ground_lost = self.view.is_ground_lost();
        self.facts.sees_nothing = self.view.sees_nothing();
    }

    /// Takes a result that came out.
    pub(super) fn record(&mut self, run: &RunDescription, header: &FrameHeader) {
        self.follow(run);
        self.facts.take_result(header);
        self.budgets.record(header);
    }

    /// Judges the state, and publishes it if it changed or is due. Returns it if state, reason or sight changed. `end`: why the pipeline ends.
    pub(super) fn tick(
        &mut self,
        run: &RunDescription,
        health: &HealthWatch,
        outcome: &Outcome,
        end: Option<&str>,
    ) -> Result<Option<Status>, RuntimeError> {
        self.follow(run);
        let now_ns = monotonic_ns();
        let before = self.shown.0;
        let verdict = match end {
            Some(why) => (StatusState::Stopped, why.to_string()),
            None => self.facts.judge(now_ns, worst_stage(health, now_ns)),
        };
        self.show(now_ns, verdict);
        if before != self.shown.0 {
            self.state_since_ns = now_ns;
            if end.is_none() {
                self.log();
            }
        }
        self.output.reach_late_readers()?;
        let status = self.count(health, outcome);
        self.current = status;
        if end.is_none() {
            self.budgets.judge(now_ns, status.stages_out);
            self.judge_lateness(now_ns);
        }
        let seen = |s: &Status| (s.state, s.reason, s.blind_sectors, s.is_ground_lost);
        let has_changed =
            seen(&status) != seen(&self.published) || self.published.run_id != run.run_id;
        let is_new = has_changed || status.sequence != self.published.sequence;
        if is_new || now_ns - self.published.judged_ns >= PERIOD_NS {
            let mut header = FrameHeader::new(0, Topic::STATUS.name);
            (header.run_id, header.model_fingerprint) = (run.run_id, run.model_fingerprint);
            self.output.send(&header, &[status])?;
            self.published = status;
        }
        Ok(has_changed.then_some(status))
    }

    /// Shows a worse state at once, and a better one only if it lasts.
    fn show(&mut self, now_ns: u64, verdict: Verdict) {
        let is_begun = ![verdict.0, self.shown.0].contains(&StatusState::Starting);
        let is_better = is_begun && verdict.0 < self.shown.0;
        // Without a budget, time says nothing about frames.
        let hold_ns = self.facts.budget_ns.map_or(0, |_| HOLD_NS);
        if is_better && now_ns - *self.better_since_ns.get_or_insert(now_ns) < hold_ns {
            return;
        }
        self.better_since_ns = None;
        self.shown = verdict;
    }

    /// Reports, once for each time that the pipeline is late, that this lasts.
    fn judge_lateness(&mut self, now_ns: u64) {
        let is_late = self.shown.0 == StatusState::Late;
        if is_late && now_ns.saturating_sub(self.state_since_ns) > LASTING_NS {
            self.state_since_ns = u64::MAX;
            let seconds = LASTING_NS as f64 / 1e9;
            tracing::error!("late for {seconds} s: {}", self.shown.1);
        }
    }

    fn log(&self) {
        let (state, reason) = (self.shown.0, self.shown.1.as_str());
        let name = state.name();
        match state {
            StatusState::Starting | StatusState::Running => tracing::info!("state: {name}"),
            StatusState::Stopped => tracing::error!("state: {name}: {reason}"),
            _ => tracing::warn!("state: {name}: {reason}"),
        }
    }

    /// The state that is shown, with the current counts.
    pub(super) fn count(&mut self, health: &HealthWatch, outcome: &Outcome) -> Status {
        self.counts.update(health);
        let now_ns = monotonic_ns();
        let (facts, (state, reason)) = (&self.facts, &self.shown);
        let newest = facts.newest;
        Status {
            wire_version: WIRE_VERSION,
            state: *state as u32,
            run_id: self.run_id,
            judged_ns: now_ns,
            sequence: newest.map_or(Status::NONE, |newest| newest.sequence),
            age_ns: newest.map_or(Status::NONE, |newest| now_ns - newest.arrived_ns),
            frames_in: outcome.frames_in,
            frames_out: outcome.frames_out,
            frames_dropped: outcome.frames_skipped,
            frames_late: self.budgets.missed(None),
            stages_out: self.counts.out(outcome.frames_in, outcome.frames_out),
            stages_late: Stage::ALL.map(|stage| self.budgets.missed(Some(stage))),
            blind_sectors: facts.blind_sectors,
            not_finite_share: facts.not_finite_share,
            is_ground_lost: facts.is_ground_lost.into(),
            reason: Text::pack(reason),
        }
    }
}

/// Frames that the stages have published in a run, over the restarts of their processes.
#[derive(Clone, Debug, Default)]
struct StageCounts {
    /// Process and count of the newest heartbeat.
    seen: [(u32, u64); 4],
    out: [u64; 4],
}

impl StageCounts {
    fn update(&mut self, health: &HealthWatch) {
        for stage in Stage::ALL {
            let Some(heartbeat) = health.of(stage) else {
                continue;
            };
            let (seen, out) = (&mut self.seen[stage as usize], heartbeat.frames_out);
            self.out[stage as usize] += match *seen {
                (pid, before) if pid == heartbeat.pid => out.saturating_sub(before),
                // The process may have published before the run.
                (0, _) => 0,
                _ => out,
            };
            *seen = (heartbeat.pid, out);
        }
    }

    /// The counts within limits that are known for sure: the last counts of a killed process are lost, and a resent frame is one frame.
    fn out(&self, frames_in: u64, frames_out: u64) -> [u64; 4] {
        let mut out = self.out;
        out[Stage::Ingest as usize] = frames_in;
        out[Stage::Refiner as usize] = out[Stage::Refiner as usize].max(frames_out);
        for stage in [2, 1] {
            out[stage] = out[stage].max(out[stage + 1]);
        }
        for stage in 1..out.len() {
            out[stage] = out[stage].min(out[stage - 1]);
        }
        out
    }
}

/// The newest result.
#[derive(Clone, Copy, Debug)]
struct Newest {
    sequence: u64,
    arrived_ns: u64,
    flags: Flags,
    is_usable: bool,
}

/// The facts that a judgement is based on.
#[derive(Clone, Debug, Default)]
struct Facts {
    /// `None`: there is no budget; results may come at any time.
    budget_ns: Option<u64>,
    begun_ns: u64,
    /// The sensor's period according to the settings; 0: not given.
    period_ns: u64,
    newest: Option<Newest>,
    /// The longest latency of a result, ns.
    longest_ns: u64,
    /// The newest scan: sequence and arrival.
    scan: Option<(u64, u64)>,
    /// The last two periods of the sensor, and the shorter one of the first two in the run.
    periods_ns: [u64; 2],
    first_period_ns: u64,
    not_finite_share: f32,
    expected_sectors: u64,
    blind_sectors: u64,
    is_ground_lost: bool,
    sees_nothing: bool,
}

impl Facts {
    fn take_scan(&mut self, header: &FrameHeader) {
        let arrived_ns = header.stages[Stage::Ingest as usize].received_ns;
        if let Some((sequence, before_ns)) = self.scan
            && header.sequence > sequence
        {
            let frames = header.sequence - sequence;
            let period_ns = arrived_ns.saturating_sub(before_ns) / frames;
            self.periods_ns = [self.periods_ns[1], period_ns];
            if self.first_period_ns == 0 {
                self.first_period_ns = self.periods_ns[0].min(period_ns);
            }
        }
        self.scan = Some((header.sequence, arrived_ns));
        // Only the points that are not finite: dropped points that did not fit are finite.
        let not_finite = header.points_dropped.saturating_sub(header.limit_dropped);
        self.not_finite_share = (not_finite as f32 / header.points_in.max(1) as f32).min(1.0);
    }

    fn take_result(&mut self, header: &FrameHeader) {
        // A stamp from the future gives no negative age.
        let (now_ns, received_ns) = (monotonic_ns(), header.stages[0].received_ns);
        let way_ns = latency_us(header).saturating_mul(1000);
        let way_ns = way_ns.min(now_ns.saturating_sub(received_ns));
        self.longest_ns = self.longest_ns.max(way_ns);
        self.newest = Some(Newest {
            sequence: header.sequence,
            arrived_ns: received_ns.min(now_ns),
            flags: Flags(header.flags),
            is_usable: header.is_usable(),
        });
    }

    /// Ages of the newest result, ns: from the first it is late, from the second no more results are expected.
    fn limits_ns(&self) -> [u64; 2] {
        let Some(budget_ns) = self.budget_ns else {
            return [u64::MAX, SILENCE_NS + 2 * self.longest_ns];
        };
        // The shorter of two periods, with an upper bound: an outage is no period.
        let period_ns = match self.periods_ns[0] {
            0 => PERIOD_UNKNOWN_NS,
            before_ns => before_ns.min(self.periods_ns[1]),
        };
        let period_ns = period_ns.min(PERIOD_MAX_NS.max(self.period_ns).max(self.first_period_ns));
        let late_ns = budget_ns + period_ns;
        [late_ns, late_ns + SILENCE_NS]
    }

    /// `stage`: whether results suffer, and what the stage in the worst state says.
    fn judge(&self, now_ns: u64, stage: Option<(bool, String)>) -> Verdict {
        use StatusState::{Blind, Degraded, Late, Running, Starting, Stopped};
        let because = |what: &str| match &stage {
            Some((_, why)) => format!("{what}: {why}"),
            None => what.to_string(),
        };
        let Some(newest) = self.newest else {
            let is_long = now_ns.saturating_sub(self.begun_ns) > START_MAX_NS;
            let state = if is_long { Stopped } else { Starting };
            return (state, because("no result yet"));
        };
        let age_ns = now_ns.saturating_sub(newest.arrived_ns);
        let [late_ns, stopped_ns] = self.limits_ns();
        if age_ns > stopped_ns {
            return (Stopped, because("no results come"));
        }
        let [expected, blind] =
            [self.expected_sectors, self.blind_sectors].map(|sectors| sectors.count_ones());
        let no_returns = || format!("{blind} of {expected} directions have no returns");
        if blind > 0 && 2 * blind >= expected {
            return (Blind, no_returns());
        }
        if let Some(why) = self.unusable(newest) {
            return (Blind, why.to_string());
        }
        if age_ns > late_ns {
            return (Late, because("results are older than the budget allows"));
        }
        if blind > 0 {
            return (Degraded, no_returns());
        }
        if self.is_ground_lost {
            return (Degraded, "the ground is not found any more".to_string());
        }
        // `limit_work` says what was left out, if something was.
        let is_cut = newest.flags.contains(Flags::DEGRADED);
        let is_complaint = |name: &&str| {
            let is_why = name.starts_with("suspect_") || (is_cut && *name == "limit_work");
            is_why || COMPLAINTS.contains(name)
        };
        let complaints: Vec<_> = newest.flags.names().filter(is_complaint).collect();
        if !complaints.is_empty() {
            // The stage that set the flags may know more.
            let more = stage.filter(|(costs, _)| *costs);
            let more = more.map_or(String::new(), |(_, why)| format!("; {why}"));
            return (Degraded, format!("flags: {}{more}", complaints.join(", ")));
        }
        if let Some((true, why)) = stage {
            return (Degraded, why);
        }
        (Running, String::new())
    }

    /// Why the newest scans are of no use, if so.
    fn unusable(&self, newest: Newest) -> Option<&'static str> {
        let is = |flag| newest.flags.contains(flag);
        let unit = "the scans have another unit: ingest's log says what helps";
        let axes = "the scans have other axes: ingest's log says what helps";
        let few = "at most 5 % of the points or fewer than 50 are finite and in the model's range";
        let reasons = [
            (self.not_finite_share > NOT_FINITE_MAX, "hardly a point is finite"),
            (is(Flags::EMPTY), "the scans are empty"),
            (self.sees_nothing, "no direction has returns"),
            (!newest.is_usable, few),
            (is(Flags::SUSPECT_UNIT), unit),
            (is(Flags::SUSPECT_AXES), axes),
        ];
        reasons.into_iter().find_map(|(holds, why)| holds.then_some(why))
    }
}

/// Whether results suffer from a stage, and what the stage in the worst state says.
fn worst_stage(health: &HealthWatch, now_ns: u64) -> Option<(bool, String)> {
    let words = Stage::ALL.into_iter().filter_map(|stage| {
        let name = stage.name();
        let Some(heartbeat) = health.of(stage) else {
            return Some((2, false, format!("{name} is not heard of")));
        };
        if now_ns.saturating_sub(health.heard_ns(stage)) > SILENCE_NS {
            return Some((3, true, format!("{name} is silent")));
        }
        let (_, state) = heartbeat.checked().ok()?;
        let (rank, costs) = match state {
            HealthState::Running => return None,
            HealthState::Starting | HealthState::Stopping => (2, false),
            HealthState::Degraded | HealthState::Failed => (1, true),
            HealthState::WaitingInput => (0, false),
        };
        let (state, reason) = (state.name(), heartbeat.reason());
        let what = if reason.is_empty() { state } else { reason };
        Some((rank, costs, format!("{name}: {what}")))
    });
    let words: Vec<_> = words.collect();
    let costs = words.iter().any(|(_, costs, _)| *costs);
    // Of equal ones, the first stage in the order of the frames.
    let worst = words.into_iter().min_by_key(|(rank, ..)| std::cmp::Reverse(*rank))?;
    Some((costs, worst.2))
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    /// A run with a budget of 200 ms whose newest result, of a scan that arrived at 5 s, took 60 ms.
    fn facts(flags: Flags, period_ms: u64) -> Facts {
        let mut facts =
            Facts { budget_ns: Some(200 * MS), expected_sectors: 0xfff, ..Facts::default() };
        for number in 0..=3 {
            let mut header = FrameHeader::new(number, "a");
            header.flag(flags);
            (header.points_in, header.points_dropped) = (100, 40);
            header.limit_dropped = 10;
            let arrived_ns = (5_000 - period_ms * (3 - number)) * MS;
            header.stages[0].received_ns = arrived_ns;
            header.stages[3].published_ns = arrived_ns + 60 * MS;
            facts.take_scan(&header);
            facts.take_result(&header);
        }
        facts
    }

    #[test]
    fn no_stage_publishes_more_than_the_one_before_or_less_than_came_out() {
        let counts = |out| StageCounts { out, ..StageCounts::default() };
        // The backbone was killed before it had reported 2 frames; in the second case, frames were sent twice.
        assert_eq!(counts([0, 88, 90, 89]).out(100, 88), [100, 90, 90, 89]);
        assert_eq!(counts([0, 12, 12, 12]).out(10, 10), [10; 4]);
    }

    /// Each line: what is changed, ms after the scan's arrival, what the worst stage says, and the verdict.
    const CASES: &str = include_str!("status_cases.txt");

    #[test]
    fn states_follow_from_the_clock_the_sight_and_the_stages() {
        for case in CASES.lines() {
            let [change, ms, stage, expected] =
                std::array::from_fn(|column| case.split(", ").nth(column).unwrap_or_default());
            let flags = match change {
                "empty" => Flags::EMPTY,
                "suspect" => Flags::SUSPECT_HEIGHT,
                "feet" => Flags::SUSPECT_UNIT,
                "slow refiner" => Flags::DEGRADED.with(Flags::LIMIT_WORK),
                _ => Flags::default(),
            };
            let mut facts = facts(flags, if change == "slow" { 1_500 } else { 100 });
            match change {
                "half" => facts.blind_sectors = 0x3f,
                "one" => facts.blind_sectors = 1,
                "nan" => facts.not_finite_share = 0.95,
                "dark" => facts.sees_nothing = true,
                "unusable" => facts.newest.iter_mut().for_each(|n| n.is_usable = false),
                "ground" => facts.is_ground_lost = true,
                "new" => facts.newest = None,
                // Nothing came for 5 s, once.
                "outage" => facts.periods_ns = [5_000 * MS, 100 * MS],
                // A result may take its time: 1 s and twice the longest so far.
                "pace" => facts.budget_ns = None,
                _ => (),
            }
            let stage = stage.split_once(": ");
            let stage = stage.map(|(suffers, why)| (suffers == "yes", why.to_string()));
            let ms: u64 = ms.parse().expect("a number");
            let (state, reason) = facts.judge((5_000 + ms) * MS, stage);
            let told = format!("{} {}", state.name(), reason.replace(", ", "/"));
            assert_eq!(told.trim_end(), expected, "{case}");
        }
        assert_eq!(facts(Flags::TRUNCATED, 100).not_finite_share, 0.3);
    }
}
