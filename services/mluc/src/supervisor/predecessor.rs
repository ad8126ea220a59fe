//! Cleans up after a supervisor that was killed: its stages, which the kernel asks to end, and their ports.

use anyhow::Context;
use mluc_runtime::Instance;
use rustix::process::{Pid, Signal, geteuid, kill_process};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Orphans end by themselves within a frame; one that does not is killed.
const ORPHAN_PATIENCE: Duration = Duration::from_secs(1);
/// Limit of the cleaning, which takes 20 ms; a generous guess.
const CLEAN_PATIENCE: Duration = Duration::from_secs(3);
/// Environment variable of the stages of a supervisor, and of all that they start.
pub(super) const MARK: &str = "MLUC_SUPERVISOR";

/// The variable's value, which identifies the supervisor: user, PID namespace (a container has its own), instance, process id, and
/// the start of the process, so that no later process is taken for it.
pub(super) fn mark(instance: &Instance) -> String {
    let pid = std::process::id();
    mark_start(instance) + &format!("{pid}/{}", start_of(pid).unwrap_or_default())
}

fn mark_start(instance: &Instance) -> String {
    let namespace = std::fs::read_link("/proc/self/ns/pid").unwrap_or_default();
    let (user, name) = (geteuid().as_raw(), instance.name());
    format!("{user}/{}/{name}/", namespace.display())
}

/// When a living process began, in the kernel's ticks: field 22. Field 2, a name, may contain any character.
fn start_of(pid: u32) -> Option<String> {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    let mut fields = stat.rsplit(')').next()?.split_whitespace();
    // A zombie, whose parent has not taken its exit code yet, is dead too.
    let is_dead = matches!(fields.next()?, "Z" | "X");
    let start = fields.nth(18)?.to_string();
    (!is_dead).then_some(start)
}

/// Waits until the stages of a killed supervisor are gone, and what they started.
pub(super) fn end_orphans(instance: &Instance) {
    let begun = Instant::now();
    loop {
        let orphans = orphans(instance);
        if orphans.is_empty() || begun.elapsed() > 2 * ORPHAN_PATIENCE {
            return;
        }
        if begun.elapsed() > ORPHAN_PATIENCE {
            for &pid in &orphans {
                tracing::warn!(pid, "a stage of a supervisor that was killed does not end: killed");
                let _ = Pid::from_raw(pid as i32).map(|pid| kill_process(pid, Signal::KILL));
            }
        }
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// Processes that carry the mark of a supervisor of this instance that is gone.
fn orphans(instance: &Instance) -> Vec<u32> {
    let entries = std::fs::read_dir("/proc").into_iter().flatten().flatten();
    let pids = entries.filter_map(|entry| entry.file_name().to_str()?.parse().ok());
    let mark = format!("{MARK}={}", mark_start(instance));
    let is_orphan = |pid: &u32| {
        let environment = std::fs::read(format!("/proc/{pid}/environ")).unwrap_or_default();
        let mut variables = environment.split(|byte| *byte == 0);
        let supervisor = variables.find_map(|v| str::from_utf8(v).ok()?.strip_prefix(&mark));
        let supervisor = supervisor.and_then(|supervisor| supervisor.split_once('/'));
        supervisor.is_some_and(|(pid, start)| {
            pid.parse().ok().and_then(start_of).as_deref() != Some(start)
        })
    };
    pids.filter(is_orphan).collect()
}

/// Removes the ports of dead processes in a separate process, because iceoryx2's cleaning may hang.
pub(super) fn clean(instance: &Instance) -> anyhow::Result<()> {
    let mut command = Command::new(crate::external::own_program());
    command.args(["clean", "--instance", instance.name()]);
    command.stdin(Stdio::null()).stdout(Stdio::null());
    let mut process = command.spawn().context("starting mluc clean")?;
    let begun = Instant::now();
    while process.try_wait().context("watching mluc clean")?.is_none() {
        if begun.elapsed() > CLEAN_PATIENCE {
            tracing::warn!("cleaning up after dead processes hangs: killed");
            let _ = process.kill();
            let _ = process.wait();
            break;
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    Ok(())
}
