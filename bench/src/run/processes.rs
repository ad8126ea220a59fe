//! Resources that each stage's process uses, read from `/proc` at intervals.

use crate::report::Resources;
use procfs::process::Process;

/// Shortest interval between two samples, s.
const PERIOD_S: f64 = 0.5;

/// What the kernel has counted for one process up to now.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Counts {
    at_s: f64,
    pid: u32,
    threads: u32,
    cpu_ns: u64,
    waiting_ns: u64,
    forced: u64,
    private_mib: f64,
    shared_mib: f64,
}

#[derive(Default)]
pub(crate) struct ProcessWatch {
    pub(crate) stages: [StageWatch; 4],
    looked_s: Option<f64>,
}

/// Samples of one stage in the measured part: the first, the last, and the largest memory.
#[derive(Default)]
pub(crate) struct StageWatch {
    first: Option<Counts>,
    last: Counts,
    peak_mib: [f64; 2],
}

impl ProcessWatch {
    /// Samples the processes. `at_s`: time since the first frame was due, s.
    pub(crate) fn look(&mut self, at_s: f64, is_measured: bool, processes: [u32; 4]) {
        let is_soon = |looked_s: f64| at_s - looked_s < PERIOD_S;
        if self.looked_s.is_some_and(is_soon) {
            return;
        }
        self.looked_s = Some(at_s);
        for (stage, pid) in processes.into_iter().enumerate() {
            let Some(counts) = counts(pid, at_s) else {
                continue;
            };
            let watch = &mut self.stages[stage];
            watch.last = counts;
            if is_measured {
                // The counters of a restarted process start again.
                if watch.first.is_none_or(|first| first.pid != pid) {
                    watch.first = Some(counts);
                }
                let now_mib = [counts.private_mib, counts.shared_mib];
                watch.peak_mib = [0, 1].map(|i| watch.peak_mib[i].max(now_mib[i]));
            }
        }
    }
}

impl StageWatch {
    pub(crate) fn resources(&self) -> Resources {
        let Some(first) = &self.first else {
            return Resources::default();
        };
        let last = &self.last;
        let seconds = (last.at_s - first.at_s).max(1e-3);
        let by_second = |from: u64, to: u64| to.saturating_sub(from) as f64 / seconds;
        Resources {
            threads: last.threads,
            cpu_cores: by_second(first.cpu_ns, last.cpu_ns) * 1e-9,
            memory_mib: self.peak_mib[0],
            shared_memory_mib: self.peak_mib[1],
            switches_forced_per_s: by_second(first.forced, last.forced),
            waiting_for_cpu: by_second(first.waiting_ns, last.waiting_ns) * 1e-9,
        }
    }
}

/// The counts of a process; `None`: the process is gone.
fn counts(pid: u32, at_s: f64) -> Option<Counts> {
    /// The kernel's unit of CPU time, on every processor: 1/100 s.
    const TICK_NS: u64 = 10_000_000;
    let process = Process::new(pid as i32).ok()?;
    let (status, stat) = (process.status().ok()?, process.stat().ok()?);
    let mib = |kib: Option<u64>| kib.unwrap_or(0) as f64 / 1024.0;
    let mut counts = Counts {
        at_s,
        pid,
        private_mib: mib(status.rssanon) + mib(status.rssfile),
        shared_mib: mib(status.rssshmem),
        // CPU time of all threads, including those that have ended.
        cpu_ns: (stat.utime + stat.stime) * TICK_NS,
        ..Counts::default()
    };
    for task in process.tasks().ok()?.flatten() {
        counts.threads += 1;
        counts.waiting_ns += task.schedstat().map_or(0, |times| times.run_delay);
        let Ok(status) = task.status() else { continue };
        counts.forced += status.nonvoluntary_ctxt_switches.unwrap_or(0);
    }
    Some(counts)
}
