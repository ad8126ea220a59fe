//! A wake-up that carries nothing.
//!
//! A named POSIX semaphore is a counter in shared memory; glibc posts with one FUTEX_WAKE and waits with one FUTEX_WAIT.
//! A futex of our own would take unsafe code for the mapping and would be no faster.

use anyhow::{Context, Result, ensure};
use iceoryx2::prelude::{FileName, SemanticString};
use iceoryx2_bb_posix::clock::ClockType;
use iceoryx2_bb_posix::creation_mode::CreationMode;
use iceoryx2_bb_posix::permission::Permission;
use iceoryx2_bb_posix::semaphore::{NamedSemaphoreBuilder, SemaphoreInterface};
use mluc_runtime::monotonic_ns;

use super::{Arrived, Link, PATIENCE, Receiver, Sender, Sent, Way, silence};

pub(super) fn sender(link: &Link) -> Result<Sender> {
    let semaphore = NamedSemaphoreBuilder::new(&name(link)?)
        .clock_type(ClockType::Realtime)
        .creation_mode(CreationMode::PurgeAndCreate)
        .permission(Permission::OWNER_READ_WRITE)
        .initial_value(0)
        .create()
        .context("making a semaphore")?;
    Ok(Box::new(move |_word| {
        let at_ns = monotonic_ns();
        semaphore.post().context("waking")?;
        Ok(Sent {
            at_ns,
            occupied_ns: monotonic_ns() - at_ns,
            sum: 0,
        })
    }))
}

pub(super) fn receiver(link: &Link) -> Result<Receiver> {
    let semaphore = NamedSemaphoreBuilder::new(&name(link)?)
        .clock_type(ClockType::Realtime)
        .open_existing()
        .context("opening a semaphore")?;
    Ok(Box::new(move || {
        let is_woken = semaphore.timed_wait(PATIENCE).context("waiting")?;
        let at_ns = monotonic_ns();
        ensure!(is_woken, silence(Way::Futex));
        Ok(Arrived { at_ns, sum: 0 })
    }))
}

fn name(link: &Link) -> Result<FileName> {
    FileName::new(format!("mluc-{}", link.label).as_bytes()).context("a semaphore's name")
}
