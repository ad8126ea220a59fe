//! Notifications to systemd from a service of `Type=notify`: it is ready, it is alive, it ends (sd_notify(3)).

use crate::{Shutdown, monotonic_ns};
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::{ffi::OsStr, os::linux::net::SocketAddrExt, os::unix::ffi::OsStrExt};

/// Variables of the service manager, which a service must not pass on to the processes that it starts.
pub const MANAGER_VARIABLES: [&str; 3] = ["NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"];

/// The connection to the manager of this service.
pub(crate) struct Manager {
    socket: UnixDatagram,
    address: SocketAddr,
    /// Time between two watchdog notifications, ns: half of `WatchdogSec`. 0: none are requested.
    period_ns: u64,
    alive_ns: u64,
    is_ready: bool,
}

impl Manager {
    /// `None`: no service manager requests notifications.
    pub(crate) fn from_environment() -> Option<Manager> {
        let name = std::env::var_os("NOTIFY_SOCKET")?;
        let number = |variable: &str| std::env::var(variable).ok()?.parse::<u64>().ok();
        let is_ours = number("WATCHDOG_PID").is_none_or(|pid| pid == u64::from(std::process::id()));
        let watchdog_us = number("WATCHDOG_USEC").filter(|_| is_ours).unwrap_or(0);
        let socket = UnixDatagram::unbound().ok()?;
        // The manager's queue may be full: this process does not wait for it.
        socket.set_nonblocking(true).ok()?;
        Some(Manager {
            socket,
            address: address(&name)?,
            period_ns: watchdog_us * 1000 / 2,
            alive_ns: 0,
            is_ready: false,
        })
    }

    fn say(&self, text: &str) {
        if let Err(error) = self.socket.send_to_addr(text.as_bytes(), &self.address) {
            tracing::debug!(%error, "telling the service manager: {text}");
        }
    }

    pub(crate) fn ready(&mut self) {
        if !std::mem::replace(&mut self.is_ready, true) {
            self.say("READY=1");
        }
    }

    /// Sends a watchdog notification if one is due; may be called at any rate.
    pub(crate) fn alive(&mut self) {
        let now_ns = monotonic_ns();
        if self.period_ns > 0 && now_ns - self.alive_ns >= self.period_ns {
            self.alive_ns = now_ns;
            self.say("WATCHDOG=1");
        }
    }
}

impl Drop for Manager {
    fn drop(&mut self) {
        // A program that only closes a handle of the C library goes on.
        if Shutdown::on_signals().is_ok_and(|asked| asked.is_requested()) {
            self.say("STOPPING=1");
        }
    }
}

/// A socket path, or after `@` an abstract name, which has no file.
fn address(name: &OsStr) -> Option<SocketAddr> {
    match name.as_bytes() {
        [b'@', rest @ ..] => SocketAddr::from_abstract_name(rest).ok(),
        _ => SocketAddr::from_pathname(name).ok(),
    }
}
