//! Other work on the machine, as a vehicle computer has it.

use std::hint::black_box;
use std::iter::repeat_n;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use super::arguments::LoadTable;

/// Memory of a thread that only computes, words: the nearest cache holds it.
const CACHED_WORDS: usize = 1024;
/// Until all memory is touched and the threads run.
const SETTLE: Duration = Duration::from_millis(500);

/// Threads that write memory over and over, each its own, until it is dropped.
pub(crate) struct Neighbour {
    is_over: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
}

impl Neighbour {
    /// Waits until it is at work.
    pub(crate) fn start(load: &LoadTable) -> Neighbour {
        let is_over = Arc::new(AtomicBool::new(false));
        let large = (load.memory_mib << 20) as usize / size_of::<u64>();
        let sizes = repeat_n(CACHED_WORDS, load.cpu_threads);
        let sizes = sizes.chain((large > 0).then_some(large));
        let spawn = |words: usize| {
            let is_over = is_over.clone();
            thread::spawn(move || {
                let mut memory = vec![0u64; words];
                while !is_over.load(Ordering::Relaxed) {
                    memory[0] += 1;
                    let round = memory[0];
                    black_box(&mut memory).fill(round);
                }
            })
        };
        let threads: Vec<_> = sizes.map(spawn).collect();
        if !threads.is_empty() {
            thread::sleep(SETTLE);
        }
        Neighbour { is_over, threads }
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
