//! Where a stage runs: its cores, its priority and its locked memory. A setting that this user has no right to is a warning.
//!
//! Cores are set by the process itself, before it starts threads. A real-time priority needs a call that only `unsafe` code
//! can make; `chrt` of util-linux, which every distribution has, makes it and becomes the stage.

use crate::{UsageError, settings::StageSettings};
use anyhow::Context;
use rustix::mm::{MlockAllFlags, mlockall};
use rustix::process::{Resource, getrlimit};
use rustix::thread::{CapabilitySet, CpuSet, capabilities, sched_getaffinity, sched_setaffinity};
use std::{path::PathBuf, process::Command};

impl StageSettings {
    pub(crate) fn check_placement(&self, stage: &str) -> Result<(), UsageError> {
        if let Some(cpus) = &self.cpus {
            let last = last_cpu();
            if cpus.is_empty() || cpus.iter().any(|cpu| *cpu > last) {
                let expected = format!("cores of this machine, 0 to {last}");
                let text = format!("cpus of {stage}: expected {expected}, found {cpus:?}");
                return Err(UsageError(text));
            }
        }
        let is_wrong = |priority: &u8| !(1..=99).contains(priority);
        let found = self.priority.filter(is_wrong);
        found.map_or(Ok(()), |found| {
            let text = format!("priority of {stage} must be 1 to 99, found {found}");
            Err(UsageError(text))
        })
    }

    /// Whether this user may have the priority; tested with a program that does nothing.
    pub(crate) fn check_right(&self, stage: &str) -> Result<(), UsageError> {
        let Some(priority) = self.priority else {
            return Ok(());
        };
        let cause = match at_priority(priority, "true".into()).output() {
            Ok(tried) if tried.status.success() => return Ok(()),
            Ok(_) => "not permitted: run as root, or allow it with `ulimit -r` or the capability CAP_SYS_NICE".to_string(),
            Err(error) => format!("chrt (package util-linux): {error}"),
        };
        let what = format!("real-time priority {priority} is not available");
        Err(UsageError(format!("priority of {stage}: {what}: {cause}")))
    }

    /// The command that starts `program`, with the stage's priority if this user may have it.
    pub(crate) fn placed(&self, program: PathBuf) -> Command {
        let has_right = self.check_right("").is_ok();
        match self.priority.filter(|_| has_right) {
            Some(priority) => at_priority(priority, program),
            None => Command::new(program),
        }
    }

    /// The cores, for `mluc exec`.
    pub(crate) fn cpus_argument(&self) -> Option<String> {
        let words: Vec<String> = self.cpus.as_ref()?.iter().map(usize::to_string).collect();
        Some(format!("--cpus={}", words.join(",")))
    }
}

fn at_priority(priority: u8, program: PathBuf) -> Command {
    let mut command = Command::new("chrt");
    // Short options: BusyBox has no others.
    command.args(["-f", &priority.to_string()]).arg(program);
    command
}

/// Locks the present and the later memory of this process, page by page when it is touched, so that it is not paged out.
pub(crate) fn lock_memory() -> Result<(), String> {
    // With a limit, the call may succeed and a later allocation may fail.
    let is_free = getrlimit(Resource::Memlock).current.is_none();
    let own = capabilities(None).map(|own| own.effective);
    if !is_free && !own.is_ok_and(|own| own.contains(CapabilitySet::IPC_LOCK)) {
        let right = "`ulimit -l unlimited` or the capability CAP_IPC_LOCK";
        return Err(format!("not permitted: allow it with {right}"));
    }
    let flags = MlockAllFlags::CURRENT | MlockAllFlags::FUTURE | MlockAllFlags::ONFAULT;
    mlockall(flags).map_err(|error| error.to_string())
}

/// The machine's last core, whether this process may use it or not.
fn last_cpu() -> usize {
    let text = std::fs::read_to_string("/sys/devices/system/cpu/possible").unwrap_or_default();
    let last = text.trim().rsplit(['-', ',']).next();
    last.and_then(|word| word.parse().ok()).unwrap_or(CpuSet::MAX_CPU - 1).min(CpuSet::MAX_CPU - 1)
}

/// Cores that this process may run on.
pub fn usable_cpus() -> Vec<usize> {
    let set = sched_getaffinity(None).unwrap_or_default();
    let all = 0..CpuSet::MAX_CPU;
    all.filter(|&cpu| set.is_set(cpu)).collect()
}

/// Pins this process, and what it starts from now on, to those of `cpus` that it may use.
pub fn pin(cpus: &[usize]) -> anyhow::Result<()> {
    let usable = usable_cpus();
    let (own, others): (Vec<usize>, Vec<usize>) = cpus.iter().partition(|cpu| usable.contains(cpu));
    if !others.is_empty() {
        tracing::warn!(
            "cpus: this process may use cores {usable:?} and not {others:?}, which are left out"
        );
    }
    if own.is_empty() {
        return Ok(());
    }
    let mut set = CpuSet::new();
    for cpu in own {
        set.set(cpu);
    }
    sched_setaffinity(None, &set).with_context(|| format!("pinning this process to cores {cpus:?}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cores_that_may_not_be_used_are_left_out() {
        // Concerns only the thread of this test.
        let before = usable_cpus();
        pin(&[before[0], CpuSet::MAX_CPU - 1]).unwrap();
        assert_eq!(usable_cpus(), before[..1]);
        pin(&[CpuSet::MAX_CPU - 1]).unwrap();
        assert_eq!(usable_cpus(), before[..1]);
    }
}
