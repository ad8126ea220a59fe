//! What can go wrong between processes, said so that the reader knows what to do.

use std::{fmt::Display, path::PathBuf};

pub(crate) type Result<T> = std::result::Result<T, RuntimeError>;

/// A failure of the process shell.
#[derive(Debug, thiserror::Error)]
pub enum RuntimeError {
    /// A role that only one process may have is taken: role, instance, process, which is `?` when it did not say.
    #[error(
        "{0} of instance '{1}' is already run by process {2}: stop it, or choose another name with --instance"
    )]
    AlreadyRunning(String, String, String),
    /// The instance cannot be named so or joined; a topic cannot be opened, or a message of it cannot be lent, sent or taken; the file system failed.
    #[error("{0}")]
    Failed(String),
}

impl RuntimeError {
    pub(crate) fn instance(instance: &str, cause: impl Display) -> RuntimeError {
        RuntimeError::Failed(format!("instance '{instance}': {cause}"))
    }

    pub(crate) fn topic(instance: &str, topic: &str, cause: impl Display) -> RuntimeError {
        let what = format!("topic {topic} of instance '{instance}'");
        RuntimeError::Failed(format!("{what}: {cause}"))
    }

    /// For `map_err` on the file system.
    pub(crate) fn io(
        action: &'static str,
        path: impl Into<PathBuf>,
    ) -> impl FnOnce(std::io::Error) -> RuntimeError {
        let path = path.into();
        move |error| RuntimeError::Failed(format!("{action} {}: {error}", path.display()))
    }
}
