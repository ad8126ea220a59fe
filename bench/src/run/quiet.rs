//! How quiet the machine was: what others took of it while the pipeline ran.

use std::fs;
use std::time::Instant;

use serde_json::{Map, Value, json};

use crate::machine::{load, number_of, object};

/// Share of all cores that other processes may take on a quiet machine; above, figures are upper bounds.
const QUIET_SHARE: f64 = 0.02;
/// From here on they say little.
const NOISY_SHARE: f64 = 0.10;
/// Share of the time that the hypervisor may give to other machines.
const STEAL_SHARE: f64 = 0.005;

/// The kernel's counters at one moment, in its own ticks.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Ticks {
    busy: u64,
    steal: u64,
    all: u64,
    ours: u64,
    switches: u64,
}

/// Sums up over the rounds.
#[derive(Default)]
pub(crate) struct Quiet {
    begun: Option<(Ticks, Instant)>,
    sum: Ticks,
    seconds: f64,
    load_before: f64,
}

impl Quiet {
    pub(crate) fn new() -> Quiet {
        Quiet {
            load_before: load(),
            ..Quiet::default()
        }
    }

    /// Before the processes of a round start.
    pub(crate) fn begin(&mut self) {
        self.begun = Some((now(), Instant::now()));
    }

    /// When all of them have ended: only then the kernel has added up what they took.
    pub(crate) fn end(&mut self) {
        let Some((begun, at)) = self.begun.take() else {
            return;
        };
        let end = now();
        self.seconds += at.elapsed().as_secs_f64();
        let add = |sum: &mut u64, from: u64, to: u64| *sum += to.saturating_sub(from);
        add(&mut self.sum.busy, begun.busy, end.busy);
        add(&mut self.sum.steal, begun.steal, end.steal);
        add(&mut self.sum.all, begun.all, end.all);
        add(&mut self.sum.ours, begun.ours, end.ours);
        add(&mut self.sum.switches, begun.switches, end.switches);
    }

    /// Share of all cores that others took.
    fn others(&self) -> f64 {
        self.sum.busy.saturating_sub(self.sum.ours) as f64 / self.sum.all.max(1) as f64
    }

    fn steal(&self) -> f64 {
        self.sum.steal as f64 / self.sum.all.max(1) as f64
    }

    /// In words, and whether a reader must be warned.
    pub(crate) fn verdict(&self) -> (String, bool) {
        let (others, steal) = (self.others(), self.steal());
        let percent = |share: f64| format!("{:.1} %", 100.0 * share);
        if others > NOISY_SHARE {
            let text = format!(
                "noisy: other processes took {} of all cores; the figures are upper bounds and say little about this pipeline",
                percent(others)
            );
            (text, true)
        } else if steal > STEAL_SHARE {
            let text = format!(
                "noisy: the hypervisor gave {} of the time to other machines; the tails are theirs",
                percent(steal)
            );
            (text, true)
        } else if others > QUIET_SHARE {
            let text = format!(
                "not quite quiet: other processes took {} of all cores; the tails may be theirs",
                percent(others)
            );
            (text, true)
        } else {
            let text = format!(
                "quiet: other processes took {} of all cores",
                percent(others)
            );
            (text, false)
        }
    }

    /// For the report.
    pub(crate) fn describe(&self) -> Map<String, Value> {
        let rounded = |share: f64| (share * 1e5).round() / 1e5;
        let per_tick = self.sum.all.max(1) as f64;
        object(json!({
            "verdict": self.verdict().0,
            "other_processes_share_of_all_cores": rounded(self.others()),
            "own_share_of_all_cores": rounded(self.sum.ours as f64 / per_tick),
            "steal_share": rounded(self.steal()),
            "load_before": self.load_before,
            "load_after": load(),
            "context_switches_per_s": (self.sum.switches as f64 / self.seconds.max(1e-3)).round(),
        }))
    }
}

fn now() -> Ticks {
    let stat = fs::read_to_string("/proc/stat").unwrap_or_default();
    let own = fs::read_to_string("/proc/self/stat").unwrap_or_default();
    Ticks {
        ours: own_ticks(&own),
        ..machine_ticks(&stat)
    }
}

/// `cpu  user nice system idle iowait irq softirq steal guest guest_nice`: guests are in user and nice already.
fn machine_ticks(stat: &str) -> Ticks {
    let line = stat.lines().next().unwrap_or_default();
    let numbers: Vec<u64> = line
        .split_whitespace()
        .skip(1)
        .map(|word| word.parse().unwrap_or(0))
        .collect();
    let at = |index: usize| numbers.get(index).copied().unwrap_or(0);
    let busy = at(0) + at(1) + at(2) + at(5) + at(6);
    Ticks {
        busy,
        steal: at(7),
        all: busy + at(3) + at(4) + at(7),
        switches: number_of(stat, "ctxt"),
        ours: 0,
    }
}

/// User and system time of this process and of its children that ended (proc(5), fields 14 to 17).
fn own_ticks(stat: &str) -> u64 {
    // The name in parentheses may hold anything; what follows it begins with field 3.
    let rest = stat.rsplit_once(')').map_or("", |(_, rest)| rest);
    rest.split_whitespace()
        .skip(11)
        .take(4)
        .map(|word| word.parse().unwrap_or(0))
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_kernels_lines_are_read() {
        let ticks = machine_ticks("cpu  100 20 30 800 40 1 2 7 50 0\ncpu0 1 2\nctxt 12345\n");
        assert_eq!(
            (ticks.busy, ticks.steal, ticks.all, ticks.switches),
            (153, 7, 1000, 12345)
        );
        let stat = "1 (a) b)) S 2 3 4 5 6 7 8 9 10 11 100 20 3 4 20 0 1 0";
        assert_eq!(own_ticks(stat), 127);
        assert_eq!((machine_ticks(""), own_ticks("")), (Ticks::default(), 0));
    }

    #[test]
    fn the_verdict_follows_what_others_took() {
        let with = |busy: u64, ours: u64, steal: u64| {
            let sum = Ticks {
                busy,
                ours,
                steal,
                all: 1000,
                switches: 0,
            };
            Quiet {
                sum,
                ..Quiet::default()
            }
            .verdict()
        };
        assert!(!with(510, 500, 0).1);
        assert!(with(540, 500, 0).0.starts_with("not quite quiet"));
        assert!(
            with(700, 500, 0)
                .0
                .starts_with("noisy: other processes took 20.0 %")
        );
        assert!(with(500, 500, 20).0.contains("hypervisor"));
        // Ticks of ours that the kernel counted elsewhere are no negative noise.
        assert!(!with(400, 500, 0).1);
    }
}
