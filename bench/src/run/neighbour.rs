//! Other work on the machine, as a vehicle computer has it.

use std::hint::black_box;
use std::iter::repeat_n;
use std::sync::Arc;
use std::thread;
use std::time::Duration;

use super::arguments::LoadTable;

/// Memory of a thread that only computes, words: the nearest cache holds it.
const CACHED_WORDS: usize = 1024;
/// Until all memory is touched and the threads run.
const SETTLE: Duration = Duration::from_millis(500);

/// Does a piece of work while threads write memory over and over, each its own.
pub(crate) fn beside<T>(load: &LoadTable, work: impl FnOnce() -> T) -> T {
    let large = (load.memory_mib << 20) as usize / size_of::<u64>();
    let sizes = repeat_n(CACHED_WORDS, load.cpu_threads).chain((large > 0).then_some(large));
    thread::scope(|scope| {
        // Gone when the work ends, by a panic too: then the threads end.
        let owner = Arc::new(());
        for words in sizes {
            let owner = Arc::downgrade(&owner);
            scope.spawn(move || {
                let mut memory = vec![0u64; words];
                while owner.strong_count() > 0 {
                    memory[0] += 1;
                    let round = memory[0];
                    black_box(&mut memory).fill(round);
                }
            });
        }
        if Arc::weak_count(&owner) > 0 {
            thread::sleep(SETTLE);
        }
        work()
    })
}
