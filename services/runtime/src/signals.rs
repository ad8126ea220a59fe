//! SIGTERM and SIGINT set one flag, SIGHUP sets another. The loops check these flags.

use crate::{RuntimeError, error::Result};
use nix::sys::signal::{SigSet, Signal};
use signal_hook::consts::{SIGCHLD, SIGHUP, SIGINT, SIGTERM};
use signal_hook::flag;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};

/// Makes signals what programs expect, whatever the parent has made of them: children can be waited for, requests to end arrive, and a terminal's
/// `tostop` does not stop a stage that writes to it. Programs that are started later inherit the last two.
pub fn prepare_signals() {
    // Where one of these fails, it stays as it is.
    let _ = flag::register(SIGCHLD, Arc::default());
    let ends = [Signal::SIGTERM, Signal::SIGINT, Signal::SIGHUP];
    let _ = SigSet::from_iter(ends).thread_unblock();
    let _ = SigSet::from(Signal::SIGTTOU).thread_block();
}

/// Whether this process was asked to end. Clones share the flag. The default is a flag that only [`Shutdown::request`] sets.
#[derive(Clone, Debug, Default)]
pub struct Shutdown(Arc<AtomicBool>);

impl Shutdown {
    /// Listens for SIGTERM and SIGINT; the process has one such flag, so none is missed between two connections. Repeated signals have no
    /// further effect: the process always cleans up. SIGQUIT and SIGKILL end it at once.
    pub fn on_signals() -> Result<Shutdown> {
        static ASKED: OnceLock<Shutdown> = OnceLock::new();
        if let Some(asked) = ASKED.get() {
            return Ok(asked.clone());
        }
        let asked = Shutdown::default();
        for signal in [SIGTERM, SIGINT] {
            let failed = RuntimeError::io("listening for signals", "SIGTERM, SIGINT");
            flag::register(signal, asked.0.clone()).map_err(failed)?;
        }
        Ok(ASKED.get_or_init(|| asked).clone())
    }

    /// Asks this process to end.
    pub fn request(&self) {
        self.0.store(true, Ordering::SeqCst);
    }

    /// Whether it was asked.
    pub fn is_requested(&self) -> bool {
        self.0.load(Ordering::SeqCst)
    }
}

/// Listens for SIGHUP. Each signal sets the flag, which requests a reload of the settings.
pub fn reload_flag() -> Result<Arc<AtomicBool>> {
    let flag = Arc::default();
    let done = flag::register(SIGHUP, Arc::clone(&flag)).map(|_| flag);
    done.map_err(RuntimeError::io("listening for signals", "SIGHUP"))
}
