//! What can go wrong between processes, said so that the reader knows what to do.

use std::path::PathBuf;

/// A failure of the process shell.
#[derive(Debug, thiserror::Error)]
pub enum RuntimeError {
    /// An instance name that cannot be part of a file name.
    #[error(
        "instance name '{name}': 1 to 24 of the characters a-z, A-Z, 0-9, '-' and '_' are allowed"
    )]
    InstanceName {
        /// As given.
        name: String,
    },
    /// A process of another mluc holds this instance.
    #[error(
        "instance '{instance}' speaks wire version {found} (mluc {version}, begun by {by}, process {pid}); this is mluc \
         {our_version} with wire version {expected}: stop the other one, run the same mluc on both sides, or choose \
         another --instance"
    )]
    OtherVersion {
        /// Which instance.
        instance: String,
        /// Ours.
        expected: u32,
        /// Theirs.
        found: u32,
        /// Their mluc.
        version: String,
        /// Our mluc.
        our_version: &'static str,
        /// Their role.
        by: String,
        /// Their process.
        pid: u32,
    },
    /// A role that only one process may have is taken.
    #[error(
        "{role} of instance '{instance}' is already run by process {pid}: stop it, or choose another name with --instance"
    )]
    AlreadyRunning {
        /// The role.
        role: String,
        /// Which instance.
        instance: String,
        /// Who has it; `?` when it did not say.
        pid: String,
    },
    /// A topic could not be opened.
    #[error("topic {topic} of instance '{instance}': {cause}{hint}")]
    Topic {
        /// Which topic.
        topic: String,
        /// Which instance.
        instance: String,
        /// iceoryx2's word for it.
        cause: String,
        /// What to do.
        hint: &'static str,
    },
    /// Shared memory is too small for a topic.
    #[error(
        "topic {topic} needs {needed_mib} MiB of shared memory, /dev/shm has {free_mib} MiB free: make it larger (in a \
         container: --shm-size)"
    )]
    SharedMemoryFull {
        /// Which topic.
        topic: String,
        /// Of its pool.
        needed_mib: u64,
        /// Left there.
        free_mib: u64,
    },
    /// The process could not join iceoryx2.
    #[error("joining instance '{instance}': {cause}")]
    Node {
        /// Which instance.
        instance: String,
        /// iceoryx2's word for it.
        cause: String,
    },
    /// A message could not be taken, lent or sent.
    #[error("topic {topic}: {action}: {cause}")]
    Message {
        /// Which topic.
        topic: String,
        /// What was tried.
        action: &'static str,
        /// iceoryx2's word for it.
        cause: String,
    },
    /// A payload that does not lie in a mapped segment of the instance: something copied it.
    #[error(
        "topic {topic}: a payload lies outside of the shared segments of instance '{instance}'"
    )]
    OutsideOfMapping {
        /// Which topic.
        topic: String,
        /// Which instance.
        instance: String,
    },
    /// The file system.
    #[error("{action} {}: {source}", path.display())]
    Io {
        /// What was tried.
        action: &'static str,
        /// Where.
        path: PathBuf,
        /// Why not.
        source: std::io::Error,
    },
}

impl RuntimeError {
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
