//! Keeping a thread on one core.

use anyhow::{Context, Result, ensure};
use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};

/// This thread stays on one core until this is dropped.
pub(crate) struct Pin(Option<CpuSet>);

impl Pin {
    /// `None`: it stays where the kernel puts it.
    pub(crate) fn to(core: Option<usize>) -> Result<Pin> {
        let Some(core) = core else {
            return Ok(Pin(None));
        };
        let failed = "keeping a thread on one core";
        ensure!(core < CpuSet::MAX_CPU, "{failed}: there is no core {core}");
        let before = sched_getaffinity(None).context(failed)?;
        let mut cores = CpuSet::new();
        cores.set(core);
        sched_setaffinity(None, &cores).context(failed)?;
        Ok(Pin(Some(before)))
    }
}

impl Drop for Pin {
    fn drop(&mut self) {
        if let Some(before) = &self.0 {
            // Nothing can be done about a core that was taken away meanwhile.
            let _ = sched_setaffinity(None, before);
        }
    }
}
