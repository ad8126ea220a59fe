//! Errors between processes. Their messages say what the user can do.

use std::{fmt::Display, path::PathBuf};

pub(crate) type Result<T> = std::result::Result<T, RuntimeError>;

/// A failure of the process shell.
#[derive(Debug, thiserror::Error)]
pub enum RuntimeError {
    /// Another process already has a role that only one process may have. Fields: role, instance, process id (`?` if it is unknown).
    #[error(
        "{0} of instance '{1}' is already run by process {2}: stop it, or choose another name with --instance"
    )]
    AlreadyRunning(String, String, String),
    /// The name of the instance is invalid, joining it failed, a topic or one of its messages (lend, send, take) failed, or the file system failed.
    #[error("{0}")]
    Failed(String),
}

/// What iceoryx2's refusal of a port means: all places are taken, or there is no memory for another one.
pub(crate) fn refusal(port: &str, cause: &str) -> String {
    if !cause.starts_with("UnableToCreate") {
        return format!("no place for another {port} ({cause})");
    }
    format!(
        "no shared memory for a {port} ({cause}): see `df /dev/shm`, `ulimit -n` and `ulimit -v`"
    )
}

impl RuntimeError {
    pub(crate) fn instance(instance: &str, cause: impl Display) -> RuntimeError {
        RuntimeError::Failed(format!("instance '{instance}': {cause}"))
    }

    pub(crate) fn topic(instance: &str, topic: &str, cause: impl Display) -> RuntimeError {
        let what = format!("topic {topic} of instance '{instance}'");
        RuntimeError::Failed(format!("{what}: {cause}"))
    }

    /// Makes a closure for `map_err` on errors of the file system.
    pub(crate) fn io(
        action: &'static str,
        path: impl Into<PathBuf>,
    ) -> impl FnOnce(std::io::Error) -> RuntimeError {
        let path = path.into();
        move |error| RuntimeError::Failed(format!("{action} {}: {error}", path.display()))
    }
}
