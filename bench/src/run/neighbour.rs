//! Other work on the machine, as a vehicle computer has it.

use std::hint::black_box;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use super::arguments::LoadTable;

/// Until its memory is touched and its threads run.
const SETTLE: Duration = Duration::from_millis(500);

/// Threads that compute and write memory until it is dropped.
pub(crate) struct Neighbour {
    is_over: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
}

impl Neighbour {
    /// Waits until it is at work.
    pub(crate) fn start(load: &LoadTable) -> Neighbour {
        let is_over = Arc::new(AtomicBool::new(false));
        let mut threads = Vec::new();
        for _ in 0..load.cpu_threads {
            let is_over = is_over.clone();
            threads.push(thread::spawn(move || compute(&is_over)));
        }
        if load.memory_mib > 0 {
            let words = (load.memory_mib << 20) as usize / size_of::<u64>();
            let is_over = is_over.clone();
            threads.push(thread::spawn(move || write_memory(words, &is_over)));
        }
        if !threads.is_empty() {
            thread::sleep(SETTLE);
        }
        Neighbour { is_over, threads }
    }
}

fn compute(is_over: &AtomicBool) {
    let mut value = 1.0f64;
    while !is_over.load(Ordering::Relaxed) {
        for _ in 0..1_000_000 {
            value = black_box(value * 1.000_000_1 + 1e-9);
        }
    }
}

fn write_memory(words: usize, is_over: &AtomicBool) {
    let mut memory = vec![0u64; words];
    let mut round = 0;
    while !is_over.load(Ordering::Relaxed) {
        round += 1;
        memory.fill(round);
        black_box(&memory);
    }
}

impl Drop for Neighbour {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
    }
}
