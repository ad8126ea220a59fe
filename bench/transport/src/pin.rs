//! Keeping a thread on one core.

use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};

use crate::TransportError;

/// This thread stays on one core until this is dropped.
pub(crate) struct Pin(Option<CpuSet>);

impl Pin {
    /// `None`: it stays where the kernel puts it.
    pub(crate) fn to(core: Option<usize>) -> Result<Pin, TransportError> {
        let Some(core) = core else {
            return Ok(Pin(None));
        };
        let failed = |source: rustix::io::Errno| TransportError::Io {
            action: "keeping a thread on one core",
            source: source.into(),
        };
        if core >= CpuSet::MAX_CPU {
            return Err(failed(rustix::io::Errno::INVAL));
        }
        let before = sched_getaffinity(None).map_err(failed)?;
        let mut cores = CpuSet::new();
        cores.set(core);
        sched_setaffinity(None, &cores).map_err(failed)?;
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
