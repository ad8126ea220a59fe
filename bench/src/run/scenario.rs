//! A scenario: a configuration file of `mluc up`, with a table `[bench]` of its own.

use std::path::Path;

use mluc::resolve::file_layer;
use mluc::{UsageError, document};
use serde::{Deserialize, Serialize};
use toml::Table;

/// `[bench]`. Everything may be left out; the command line wins.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct BenchTable {
    /// How long to measure, after the warm-up.
    pub(crate) seconds: Option<f64>,
    /// Frames due before count apart.
    pub(crate) warm_up_seconds: Option<f64>,
    /// Starts of the processes over which the seconds are spread.
    pub(crate) rounds: Option<u32>,
    /// Messages for the baselines; 0: none.
    #[serde(alias = "baseline_rounds")]
    pub(crate) floor_rounds: Option<usize>,
    /// Until a pipeline without objects is given up.
    pub(crate) patience_seconds: Option<f64>,
    /// Other work on the same machine.
    pub(crate) load: LoadTable,
}

/// `[bench.load]`: a process beside the pipeline.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct LoadTable {
    /// Threads that compute without a pause.
    pub(crate) cpu_threads: usize,
    /// Memory that one thread writes over and over, MiB.
    pub(crate) memory_mib: u64,
}

/// Threads of the load; a guess far above any machine.
const CPU_THREADS_MAX: usize = 1024;

impl LoadTable {
    /// Whether the machine has the memory. `available_mib` as the kernel counts it.
    pub(crate) fn check(&self, available_mib: u64) -> Result<(), UsageError> {
        if self.cpu_threads > CPU_THREADS_MAX {
            return Err(UsageError(format!(
                "bench.load.cpu_threads must be at most {CPU_THREADS_MAX}, found {}",
                self.cpu_threads
            )));
        }
        // The pipeline needs some itself; a machine that swaps measures its disk.
        if self.memory_mib > available_mib * 3 / 4 {
            return Err(UsageError(format!(
                "bench.load.memory_mib: {} MiB are asked for, {available_mib} MiB are available (three quarters of them may be asked for)",
                self.memory_mib
            )));
        }
        Ok(())
    }
}

/// The file without `[bench]`, and that table. `None`: an empty file.
pub(crate) fn read(path: Option<&Path>) -> anyhow::Result<(Table, BenchTable)> {
    #[derive(Deserialize)]
    struct Scenario {
        #[serde(default)]
        bench: BenchTable,
    }
    let Some(path) = path else {
        return Ok(Default::default());
    };
    let scenario = document::read::<Scenario>(path)?;
    Ok((file_layer(path)?, scenario.bench))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_that_is_not_there_is_refused() {
        let load = LoadTable {
            cpu_threads: 2,
            memory_mib: 800,
        };
        assert!(load.check(2000).is_ok());
        let error = load.check(900).unwrap_err().to_string();
        assert!(
            error.contains("800 MiB") && error.contains("900 MiB"),
            "{error}"
        );
        let many = LoadTable {
            cpu_threads: 1025,
            memory_mib: 0,
        };
        assert!(many.check(1000).is_err());
    }
}
