//! What a supervisor that was killed left: its stages, which the kernel asks to end, and their ports.

use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::Context;
use mluc_runtime::Instance;
use rustix::process::{Pid, Signal, geteuid, kill_process};

/// Orphans end by themselves within a frame; one that does not is killed.
const ORPHAN_PATIENCE: Duration = Duration::from_secs(1);
/// Cleaning takes 20 ms; a guess with room.
const CLEAN_PATIENCE: Duration = Duration::from_secs(3);

/// What the stages of a supervisor, and all that they start, carry in their environment.
pub(super) const MARK: &str = "MLUC_SUPERVISOR";

/// Whose they are: user, processes that see each other (a container's are a world of their own), instance, and a process that no
/// later one is taken for.
pub(super) fn mark(instance: &Instance) -> String {
    let pid = std::process::id();
    mark_start(instance) + &format!("{pid}/{}", start_of(pid).unwrap_or_default())
}

fn mark_start(instance: &Instance) -> String {
    let namespace = std::fs::read_link("/proc/self/ns/pid").unwrap_or_default();
    let (user, name) = (geteuid().as_raw(), instance.name());
    format!("{user}/{}/{name}/", namespace.display())
}

/// When a process that lives began, in the kernel's ticks: field 22; the second, a name, may hold anything.
fn start_of(pid: u32) -> Option<String> {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    let mut fields = stat.rsplit(')').next()?.split_whitespace();
    // One whose parent has not heard of its end is dead all the same.
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
                tracing::warn!(
                    pid,
                    "a stage of a supervisor that was killed does not end: killed"
                );
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
            let now = pid.parse().ok().and_then(start_of);
            now.as_deref() != Some(start)
        })
    };
    pids.filter(is_orphan).collect()
}

/// Has the ports of dead processes removed, by a process of its own: iceoryx2's cleaning may hang.
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
