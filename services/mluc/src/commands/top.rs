//! `mluc top`: prints the state of a running pipeline once a second.

use super::observe::{Observer, Snapshot, instance, running};
use super::status::{HEAD, LISTEN, row};
use crate::terminal::print_out;
use mluc_ipc_types::{Health, HealthState, Stage};
use mluc_runtime::{log_to_stderr, monotonic_ns, wall_clock_ns};
use std::{io::IsTerminal, process::ExitCode, time::Duration};

const PERIOD: Duration = Duration::from_secs(1);
const LOOK: Duration = Duration::from_millis(50);
/// Characters of the longest bar.
const BAR: u64 = 32;
/// Largest number of complaints that are shown.
const COMPLAINTS_MAX: usize = 6;
const CLEAR: &str = "\x1b[2J\x1b[H";

pub(crate) fn top(name: Option<&str>, is_once: bool) -> anyhow::Result<ExitCode> {
    log_to_stderr("top", "warn");
    let named = if is_once { running(name) } else { Ok(instance(name)?) };
    let mut observer = Observer::open(&named?)?;
    let is_screen = std::io::stdout().is_terminal() && !is_once;
    let clear = if is_screen { CLEAR } else { "" };
    let mut complaints = Complaints::default();
    let (mut before, mut before_ns) = (Snapshot::default(), monotonic_ns());
    while !observer.shell.is_stopping() {
        let snapshot = observer.look()?;
        complaints.add(&snapshot);
        let since = Duration::from_nanos(monotonic_ns() - before_ns);
        if before.instance.is_empty() {
            // By then, every stage has sent a heartbeat.
            if since >= LISTEN {
                (before, before_ns) = (snapshot, monotonic_ns());
            }
        } else if since >= PERIOD {
            let text = page(&before, &snapshot, since, &complaints);
            print_out(format_args!("{clear}{}", text.trim_end()))?;
            if is_once {
                break;
            }
            (before, before_ns) = (snapshot, monotonic_ns());
        }
        std::thread::sleep(LOOK);
    }
    Ok(ExitCode::SUCCESS)
}

fn page(before: &Snapshot, now: &Snapshot, since: Duration, complaints: &Complaints) -> String {
    let heard = || now.stages.iter().flatten();
    let longest_us = heard().map(|health| health.run_p99_us).max().unwrap_or(0);
    let longest_ms = f64::from(longest_us) / 1000.0;
    let mut text = format!("mluc {}, {}\n{HEAD}      Hz", now.instance, now.headline());
    text += &format!("  0 to {longest_ms:.1} ms: # p50, - p99\n");
    for (stage, health) in Stage::ALL.into_iter().zip(&now.stages) {
        let then = &before.stages[stage as usize];
        text += &row(stage, health.as_ref());
        if let Some(health) = health {
            let hz = rate_hz(then.as_ref(), health, since);
            text += &format!("{hz:8.1}  {}", bar(health, longest_us.into()));
        }
        text += "\n";
    }
    for (time, words) in &complaints.0 {
        text += &format!("{time} {words}\n");
    }
    text
}

/// Frames per second; the count of a restarted stage begins at 0.
fn rate_hz(then: Option<&Health>, now: &Health, since: Duration) -> f64 {
    let then = then.filter(|then| then.pid == now.pid);
    let frames = then.map_or(0, |then| now.frames_out.saturating_sub(then.frames_out));
    frames as f64 / since.as_secs_f64()
}

fn bar(health: &Health, longest_us: u64) -> String {
    let length = |us: u32| (u64::from(us) * BAR).div_ceil(longest_us.max(1)) as usize;
    let (p50, p99) = (length(health.run_p50_us), length(health.run_p99_us));
    "#".repeat(p50) + &"-".repeat(p99.saturating_sub(p50))
}

/// Complaints since the start: time and words, the newest last.
#[derive(Default)]
struct Complaints(Vec<(String, String)>);

impl Complaints {
    fn add(&mut self, snapshot: &Snapshot) {
        let state = snapshot.state().filter(|state| !state.sees());
        let status = snapshot.status.as_ref();
        let reason = status.map_or("", |status| status.reason());
        let of_all = state.map(|state| format!("{}: {reason}", state.name()));
        let is_bad = |health: &&Health| {
            let states = [HealthState::Degraded, HealthState::Failed].map(|state| state as u32);
            states.contains(&health.state)
        };
        let bad = snapshot.stages.iter().flatten().filter(is_bad);
        let of_stages = bad.map(|health| {
            let stage = Stage::ALL.get(health.stage as usize);
            let name = stage.map_or("?", |stage| stage.name());
            format!("{name}: {}", health.reason())
        });
        for words in of_all.into_iter().chain(of_stages) {
            // One complaint whose numbers change stays one.
            let kind = |text: &str| text.replace(|c: char| c.is_ascii_digit() || c == '.', "");
            self.0.retain(|(_, shown)| kind(shown) != kind(&words));
            self.0.push((time_of_day(wall_clock_ns()), words));
        }
        let over = self.0.len().saturating_sub(COMPLAINTS_MAX);
        self.0.drain(..over);
    }
}

/// The time of day in UTC.
fn time_of_day(ns: u64) -> String {
    let seconds = ns / 1_000_000_000 % 86_400;
    let (hours, minutes) = (seconds / 3600, seconds / 60 % 60);
    format!("{hours:02}:{minutes:02}:{:02}Z", seconds % 60)
}

#[cfg(test)]
mod tests {
    use super::super::observe::tests::snapshot;
    use super::*;
    use mluc_ipc_types::StatusState;

    #[test]
    fn a_page_has_rates_bars_and_complaints_once() {
        let (before, mut now) = (snapshot(StatusState::Blind), snapshot(StatusState::Blind));
        let mut complaints = Complaints::default();
        for number in 0..2 {
            complaints.add(&now);
            let refiner = now.stages[3].as_mut().expect("it is heard");
            // First 20 frames in 2 s, then a new process, whose count begins at 0.
            (refiner.frames_out, refiner.pid) = (29, 7 + number);
            let text = page(&before, &now, Duration::from_secs(2), &complaints);
            let hz = ["    10.0", "     0.0"][number as usize];
            let bar = format!("{hz}  {}{}\n", "#".repeat(8), "-".repeat(24));
            assert!(text.contains(&bar), "{text}");
            let starts =
                ["mluc demo, state: blind: a cover; newest", "stage", "ingest    -        silent"];
            for (line, start) in text.lines().zip(starts) {
                assert!(line.starts_with(start), "{text}");
            }
            assert_eq!(text.matches("Z blind: a cover").count(), 1, "{text}");
        }
    }
}
