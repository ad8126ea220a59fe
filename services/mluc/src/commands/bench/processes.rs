//! What each stage's process takes of the machine, read from `/proc` now and then.

use std::fs;

use mluc_report::{Resources, Sample};

/// Two looks at least so far apart, s.
const PERIOD_S: f64 = 0.5;

/// What the kernel has counted for one process up to now.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Counts {
    at_s: f64,
    pid: u32,
    threads: u32,
    cpu_ns: u64,
    waiting_ns: u64,
    voluntary: u64,
    forced: u64,
    private_mib: f64,
    shared_mib: f64,
}

/// Looks at the four processes while they run.
#[derive(Default)]
pub(super) struct ProcessWatch {
    first: [Option<Counts>; 4],
    last: [Option<Counts>; 4],
    peak: [Option<Counts>; 4],
    samples: Vec<Sample>,
    looked_s: Option<f64>,
}

impl ProcessWatch {
    /// `at_s`: since the first frame was due. Before the measurement begins only the running figures are kept.
    pub(super) fn look(&mut self, at_s: f64, is_measured: bool, processes: [u32; 4]) {
        if self
            .looked_s
            .is_some_and(|looked_s| at_s - looked_s < PERIOD_S)
        {
            return;
        }
        self.looked_s = Some(at_s);
        let mut sample = Sample {
            at_s,
            ..Sample::default()
        };
        for (stage, &pid) in processes.iter().enumerate() {
            let Some(counts) = counts(pid, at_s) else {
                continue;
            };
            if let Some(before) = self.last[stage].filter(|before| before.pid == pid) {
                sample.cpu_cores[stage] = cores(&before, &counts);
            }
            sample.memory_mib[stage] = counts.private_mib;
            self.last[stage] = Some(counts);
            if is_measured {
                // A restarted process counts from its own begin.
                let is_known = self.first[stage].is_some_and(|first| first.pid == pid);
                if !is_known {
                    self.first[stage] = Some(counts);
                }
                let peak = self.peak[stage].get_or_insert(counts);
                peak.private_mib = peak.private_mib.max(counts.private_mib);
                peak.shared_mib = peak.shared_mib.max(counts.shared_mib);
            }
        }
        self.samples.push(sample);
    }

    pub(super) fn samples(&self) -> &[Sample] {
        &self.samples
    }

    /// Over the measured part.
    pub(super) fn resources(&self, stage: usize) -> Resources {
        let (Some(first), Some(last), Some(peak)) =
            (self.first[stage], self.last[stage], self.peak[stage])
        else {
            return Resources::default();
        };
        let seconds = (last.at_s - first.at_s).max(1e-3);
        let by_second = |from: u64, to: u64| to.saturating_sub(from) as f64 / seconds;
        Resources {
            threads: last.threads,
            cpu_cores: cores(&first, &last),
            memory_mib: peak.private_mib,
            shared_memory_mib: peak.shared_mib,
            switches_voluntary_per_s: by_second(first.voluntary, last.voluntary),
            switches_forced_per_s: by_second(first.forced, last.forced),
            waiting_for_cpu: by_second(first.waiting_ns, last.waiting_ns) * 1e-9,
        }
    }
}

fn cores(from: &Counts, to: &Counts) -> f64 {
    let seconds = (to.at_s - from.at_s).max(1e-3);
    to.cpu_ns.saturating_sub(from.cpu_ns) as f64 * 1e-9 / seconds
}

/// `None`: the process is gone.
fn counts(pid: u32, at_s: f64) -> Option<Counts> {
    let status = fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
    let mib = |key: &str| number_of(&status, key) as f64 / 1024.0;
    let mut counts = Counts {
        at_s,
        pid,
        private_mib: mib("RssAnon:") + mib("RssFile:"),
        shared_mib: mib("RssShmem:"),
        ..Counts::default()
    };
    for task in fs::read_dir(format!("/proc/{pid}/task")).ok()?.flatten() {
        let read = |name: &str| fs::read_to_string(task.path().join(name)).unwrap_or_default();
        let (schedule, status) = (read("schedstat"), read("status"));
        let mut numbers = schedule
            .split_whitespace()
            .map(|word| word.parse().unwrap_or(0));
        counts.threads += 1;
        counts.cpu_ns += numbers.next().unwrap_or(0u64);
        counts.waiting_ns += numbers.next().unwrap_or(0u64);
        counts.voluntary += number_of(&status, "voluntary_ctxt_switches:");
        counts.forced += number_of(&status, "nonvoluntary_ctxt_switches:");
    }
    Some(counts)
}

/// The number after `key` at the begin of a line; 0 when there is none.
pub(super) fn number_of(text: &str, key: &str) -> u64 {
    let rest = text.lines().find_map(|line| line.strip_prefix(key));
    let word = rest.and_then(|rest| rest.split_whitespace().next());
    word.and_then(|word| word.parse().ok()).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn this_process_is_seen_and_a_missing_one_is_not() {
        let own = counts(std::process::id(), 0.0).unwrap();
        assert!(own.threads >= 1 && own.private_mib > 0.1, "{own:?}");
        assert_eq!(counts(0, 0.0), None);
    }

    #[test]
    fn figures_are_differences() {
        let pid = std::process::id();
        let mut watch = ProcessWatch::default();
        watch.look(-1.0, false, [pid, 0, 0, 0]);
        watch.look(0.0, true, [pid, 0, 0, 0]);
        watch.look(0.1, true, [pid, 0, 0, 0]);
        let mut value = 1u64;
        for n in 0..30_000_000u64 {
            value = std::hint::black_box(value.wrapping_mul(n | 1));
        }
        watch.look(1.0, true, [pid, 0, 0, 0]);
        assert_eq!(
            watch.samples().len(),
            3,
            "two looks were too near each other"
        );
        let resources = watch.resources(0);
        assert!(
            resources.cpu_cores > 0.0 && resources.memory_mib > 0.0,
            "{resources:?}"
        );
        assert_eq!(watch.resources(1), Resources::default());
    }

    #[test]
    fn numbers_stand_after_their_key() {
        let text = "VmRSS:\t  12 kB\nRssAnon:\t   345 kB\n";
        assert_eq!(
            (number_of(text, "RssAnon:"), number_of(text, "RssShmem:")),
            (345, 0)
        );
    }
}
