//! How quiet the machine was: the share of it that others took while the pipeline ran.

use crate::machine::load;
use procfs::{CurrentSI, KernelStats, process::Process};
use serde_json::{Value, json};
use std::time::Instant;

/// Share of all cores that other processes may take on a quiet machine; above, figures are upper bounds.
const QUIET_SHARE: f64 = 0.02;
/// Above this share, the figures say little about the pipeline.
const NOISY_SHARE: f64 = 0.10;
/// Share of the time that the hypervisor may give to other machines.
const STEAL_SHARE: f64 = 0.005;

/// The kernel's counters: busy ticks, stolen ticks, all ticks, this program's ticks; context switches.
type Ticks = [u64; 5];

#[derive(Default)]
pub(crate) struct Quiet {
    sum: Ticks,
    seconds: f64,
    load_before: f64,
}

impl Quiet {
    pub(crate) fn new() -> Quiet {
        Quiet { load_before: load(), ..Quiet::default() }
    }

    /// Watches a round. The round must end all of its processes: only then do the kernel's counters include them.
    pub(crate) fn watch<T>(&mut self, round: impl FnOnce() -> T) -> T {
        let (begun, at) = (now(), Instant::now());
        let result = round();
        let end = now();
        self.seconds += at.elapsed().as_secs_f64();
        for (sum, (from, to)) in self.sum.iter_mut().zip(begun.into_iter().zip(end)) {
            *sum += to.saturating_sub(from);
        }
        result
    }

    fn others(&self) -> f64 {
        let [busy, _, all, ours, _] = self.sum;
        busy.saturating_sub(ours) as f64 / all.max(1) as f64
    }

    fn steal(&self) -> f64 {
        let [_, steal, all, ..] = self.sum;
        steal as f64 / all.max(1) as f64
    }

    /// The verdict in words, and whether a reader must be warned.
    pub(crate) fn verdict(&self) -> (String, bool) {
        let percent = |share: f64| format!("{:.1} %", 100.0 * share);
        let (others, steal) = (percent(self.others()), percent(self.steal()));
        let took = format!("other processes took {others} of all cores");
        let text = if self.others() > NOISY_SHARE {
            format!(
                "noisy: {took}; the figures are upper bounds and say little about this pipeline"
            )
        } else if self.steal() > STEAL_SHARE {
            format!(
                "noisy: the hypervisor gave {steal} of the time to other machines; the tails are theirs"
            )
        } else if self.others() > QUIET_SHARE {
            format!("not quite quiet: {took}; the tails may be theirs")
        } else {
            return (format!("quiet: {took}"), false);
        };
        (text, true)
    }

    pub(crate) fn describe(&self) -> Value {
        let rounded = |share: f64| (share * 1e5).round() / 1e5;
        let [_, _, all, ours, switches] = self.sum;
        json!({
            "verdict": self.verdict().0,
            "other_processes_share_of_all_cores": rounded(self.others()),
            "own_share_of_all_cores": rounded(ours as f64 / all.max(1) as f64),
            "steal_share": rounded(self.steal()),
            "load_before": self.load_before,
            "load_after": load(),
            "context_switches_per_s": (switches as f64 / self.seconds.max(1e-3)).round(),
        })
    }
}

fn now() -> Ticks {
    let own = Process::myself().and_then(|own| own.stat());
    // Includes its children that have ended.
    let ours = own.map_or(0, |own| own.utime + own.stime + (own.cutime + own.cstime) as u64);
    let Ok(stats) = KernelStats::current() else {
        return Ticks::default();
    };
    let cpu = stats.total;
    let [iowait, irq, softirq, steal] =
        [cpu.iowait, cpu.irq, cpu.softirq, cpu.steal].map(Option::unwrap_or_default);
    // `user` and `nice` already include the time of guests.
    let busy = cpu.user + cpu.nice + cpu.system + irq + softirq;
    [busy, steal, busy + cpu.idle + iowait + steal, ours, stats.ctxt]
}
