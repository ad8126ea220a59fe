//! Where a stage runs: its cores and its priority.
//!
//! Cores are set by the process itself, before it starts threads. A real-time priority needs a call that only `unsafe` code
//! can make; `chrt` of util-linux, which every distribution has, makes it and becomes the stage.

use std::path::PathBuf;
use std::process::Command;

use anyhow::Context;
use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};

use crate::UsageError;
use crate::settings::StageSettings;

impl StageSettings {
    pub(crate) fn check_placement(&self, stage: &str) -> Result<(), UsageError> {
        if let Some(cpus) = &self.cpus {
            let usable = usable_cpus();
            if cpus.is_empty() || cpus.iter().any(|cpu| !usable.contains(cpu)) {
                let expected = format!("some of {usable:?}, which this process may use");
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

    /// Whether this user may have the priority: tried with a program that does nothing.
    pub(crate) fn check_right(&self, stage: &str) -> Result<(), UsageError> {
        let Some(priority) = self.priority else {
            return Ok(());
        };
        let cause = match self.placed("true".into()).output() {
            Ok(tried) if tried.status.success() => return Ok(()),
            Ok(_) => "not permitted: run as root, or allow it with `ulimit -r` or the capability CAP_SYS_NICE".to_string(),
            Err(error) => format!("chrt (package util-linux): {error}"),
        };
        let what = format!("real-time priority {priority} is not to be had");
        Err(UsageError(format!("priority of {stage}: {what}: {cause}")))
    }

    pub(crate) fn placed(&self, program: PathBuf) -> Command {
        let Some(priority) = self.priority else {
            return Command::new(program);
        };
        let mut command = Command::new("chrt");
        command.args(["--fifo", &priority.to_string()]).arg(program);
        command
    }

    /// The cores, for `mluc exec`.
    pub(crate) fn cpus_argument(&self) -> Option<String> {
        let cpus = self.cpus.as_ref()?;
        let words: Vec<String> = cpus.iter().map(usize::to_string).collect();
        Some(format!("--cpus={}", words.join(",")))
    }
}

/// Cores that this process may run on.
pub fn usable_cpus() -> Vec<usize> {
    let set = sched_getaffinity(None).unwrap_or_default();
    let all = 0..CpuSet::MAX_CPU;
    all.filter(|&cpu| set.is_set(cpu)).collect()
}

/// Keeps this process, and what it starts from now on, on `cpus`.
pub fn pin(cpus: &[usize]) -> anyhow::Result<()> {
    let mut set = CpuSet::new();
    for &cpu in cpus.iter().filter(|&&cpu| cpu < CpuSet::MAX_CPU) {
        set.set(cpu);
    }
    sched_setaffinity(None, &set).with_context(|| format!("pinning this process to cores {cpus:?}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_there_is_refused() {
        let usable = usable_cpus();
        assert!(!usable.is_empty());
        let check = |cpus: &[usize], priority| {
            let stage = StageSettings {
                cpus: Some(cpus.to_vec()),
                priority,
                ..StageSettings::default()
            };
            stage.check_placement("head").map_err(|e| e.to_string())
        };
        assert!(check(&usable, Some(10)).is_ok());
        let error = check(&[usable[0], 4000], None).unwrap_err();
        assert!(error.contains("cpus of head") && error.contains("4000"));
        assert!(check(&[], None).is_err());
        for priority in [0, 100] {
            assert!(check(&usable, Some(priority)).is_err());
        }
    }

    #[test]
    fn the_command_carries_the_priority() {
        let stage = StageSettings {
            cpus: Some(vec![0, 2]),
            priority: Some(7),
            ..StageSettings::default()
        };
        let command = stage.placed("mluc".into());
        assert_eq!(command.get_program(), "chrt");
        let words: Vec<_> = command.get_args().collect();
        assert_eq!(words, ["--fifo", "7", "mluc"]);
        assert_eq!(stage.cpus_argument().as_deref(), Some("--cpus=0,2"));
        let plain = StageSettings::default().placed("mluc".into());
        assert_eq!(plain.get_program(), "mluc");
    }
}
