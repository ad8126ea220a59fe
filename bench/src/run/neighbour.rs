//! Other work on the machine, as a vehicle computer has it.

use std::hint::black_box;
use std::process::{Child, Command, ExitCode, Stdio};
use std::time::{Duration, Instant};

use anyhow::Context;

use super::arguments::LoadTable;
use crate::transport::end_with_parent;

/// Until its memory is touched and its threads run.
const SETTLE: Duration = Duration::from_millis(500);

/// Computes and writes memory until its parent ends or ends it.
pub(crate) fn neighbour(args: LoadTable) -> anyhow::Result<ExitCode> {
    end_with_parent()?;
    let mut threads: Vec<_> = (0..args.cpu_threads)
        .map(|_| std::thread::spawn(compute))
        .collect();
    if args.memory_mib > 0 {
        let words = (args.memory_mib << 20) as usize / size_of::<u64>();
        threads.push(std::thread::spawn(move || write_memory(words)));
    }
    for thread in threads {
        let _ = thread.join();
    }
    Ok(ExitCode::SUCCESS)
}

fn compute() {
    let mut value = 1.0f64;
    loop {
        for _ in 0..1_000_000 {
            value = black_box(value * 1.000_000_1 + 1e-9);
        }
    }
}

fn write_memory(words: usize) {
    let mut memory = vec![0u64; words];
    let mut round = 0;
    loop {
        round += 1;
        memory.fill(round);
        black_box(&memory);
    }
}

/// A running one; ended when dropped.
pub(crate) struct Neighbour(Child);

impl Neighbour {
    /// Starts it when there is any load; waits until it is at work.
    pub(crate) fn start(load: &LoadTable) -> anyhow::Result<Option<Neighbour>> {
        if *load == LoadTable::default() {
            return Ok(None);
        }
        let program = std::env::current_exe().context("finding this program's file")?;
        let mut command = Command::new(program);
        command.args(["neighbour", "--cpu-threads", &load.cpu_threads.to_string()]);
        command.args(["--memory-mib", &load.memory_mib.to_string()]);
        let child = command
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .spawn()
            .context("starting the load beside the pipeline")?;
        let mut neighbour = Neighbour(child);
        let begun = Instant::now();
        while begun.elapsed() < SETTLE {
            if let Some(status) = neighbour.0.try_wait().context("watching the load")? {
                anyhow::bail!("the load beside the pipeline ended at once: {status}");
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        Ok(Some(neighbour))
    }

    /// Whether it still runs.
    pub(crate) fn is_running(&mut self) -> bool {
        matches!(self.0.try_wait(), Ok(None))
    }
}

impl Drop for Neighbour {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}
