//! What can go wrong between processes, said so that the reader knows what to do.

use std::fmt::Display;
use std::path::PathBuf;

pub(crate) type Result<T> = std::result::Result<T, RuntimeError>;

/// A failure of the process shell.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // The message above each variant says what its fields are.
pub enum RuntimeError {
    /// The instance cannot be named so, or cannot be joined.
    #[error("instance '{instance}': {cause}")]
    Instance { instance: String, cause: String },
    /// A role that only one process may have is taken; `pid` is `?` when the other process did not say.
    #[error(
        "{role} of instance '{instance}' is already run by process {pid}: stop it, or choose another name with --instance"
    )]
    AlreadyRunning {
        role: String,
        instance: String,
        pid: String,
    },
    /// A topic cannot be opened, or a message of it cannot be lent, sent or taken.
    #[error("topic {topic} of instance '{instance}': {cause}")]
    Topic {
        topic: String,
        instance: String,
        cause: String,
    },
    /// The file system.
    #[error("{action} {}: {source}", path.display())]
    Io {
        action: &'static str,
        path: PathBuf,
        source: std::io::Error,
    },
}

impl RuntimeError {
    pub(crate) fn instance(instance: &str, cause: impl Display) -> RuntimeError {
        RuntimeError::Instance {
            instance: instance.to_string(),
            cause: cause.to_string(),
        }
    }

    pub(crate) fn topic(instance: &str, topic: &str, cause: impl Display) -> RuntimeError {
        RuntimeError::Topic {
            topic: topic.to_string(),
            instance: instance.to_string(),
            cause: cause.to_string(),
        }
    }

    /// For `map_err` on the file system.
    pub(crate) fn io(
        action: &'static str,
        path: impl Into<PathBuf>,
    ) -> impl FnOnce(std::io::Error) -> RuntimeError {
        let path = path.into();
        move |source| RuntimeError::Io {
            action,
            path,
            source,
        }
    }
}
