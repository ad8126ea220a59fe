//! What a supervisor that was killed left: its stages, which the kernel asks to end, and their ports.

use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::Context;
use mluc_ipc_types::Stage;
use mluc_runtime::{ClaimNote, Instance};
use rustix::process::{Pid, Signal, kill_process_group};

/// Orphans end by themselves within a frame; one that does not is killed.
const ORPHAN_PATIENCE: Duration = Duration::from_secs(1);
/// Cleaning takes 20 ms; a guess with room.
const CLEAN_PATIENCE: Duration = Duration::from_secs(3);

/// Waits until the stages of a killed supervisor are gone.
pub(super) fn end_orphans(instance: &Instance) {
    let begun = Instant::now();
    loop {
        let orphans: Vec<u32> = Stage::ALL
            .into_iter()
            .filter_map(|s| orphan(instance, s))
            .collect();
        if orphans.is_empty() || begun.elapsed() > 2 * ORPHAN_PATIENCE {
            return;
        }
        if begun.elapsed() > ORPHAN_PATIENCE {
            for &pid in &orphans {
                tracing::warn!(
                    pid,
                    "a stage of a supervisor that was killed does not end: killed"
                );
                // A stage leads its group.
                let _ =
                    Pid::from_raw(pid as i32).map(|group| kill_process_group(group, Signal::KILL));
            }
            std::thread::sleep(Duration::from_millis(50));
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// A stage that a supervisor started and that is no longer its child. Its command line names the supervisor.
fn orphan(instance: &Instance, stage: Stage) -> Option<u32> {
    let pid = ClaimNote::of_living(instance, stage.name())?.pid;
    let read = |file: &str| std::fs::read_to_string(format!("/proc/{pid}/{file}")).ok();
    let command = read("cmdline")?;
    let mut words = command
        .split('\0')
        .skip_while(|word| *word != "--supervised-by");
    let supervisor = words.nth(1)?;
    let stat = read("stat")?;
    let parent = stat.rsplit(')').next()?.split_whitespace().nth(1)?;
    (parent != supervisor).then_some(pid)
}

/// Has the ports of dead processes removed, by a process of its own: iceoryx2's cleaning may hang.
pub(super) fn clean(instance: &Instance) -> anyhow::Result<()> {
    let program = std::env::current_exe().context("finding this program's file")?;
    let mut command = Command::new(program);
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
