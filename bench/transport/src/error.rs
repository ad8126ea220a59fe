//! What can go wrong between two processes that measure.

use mluc_runtime::RuntimeError;

/// Why nothing was measured.
#[derive(Debug, thiserror::Error)]
pub enum TransportError {
    /// Our own hop.
    #[error(transparent)]
    Runtime(#[from] RuntimeError),
    /// iceoryx2 without anything of ours, or a semaphore.
    #[error("{action}: {cause}")]
    Port {
        /// What was tried.
        action: &'static str,
        /// As told.
        cause: String,
    },
    /// A system call.
    #[error("{action}: {source}")]
    Io {
        /// What was tried.
        action: &'static str,
        /// As the system says.
        source: std::io::Error,
    },
    /// The other process ended.
    #[error(
        "the receiving process is gone while {action}: its own message is above; the program must call \
         mluc_transport::serve_peer first in main"
    )]
    PeerGone {
        /// What this side did.
        action: &'static str,
    },
    /// Nothing arrived.
    #[error("{way}: no message within {seconds} s")]
    Silence {
        /// Which way.
        way: &'static str,
        /// Patience.
        seconds: u64,
    },
    /// What arrived is not what was sent.
    #[error("{way}: a sum of {expected} was sent, {found} arrived")]
    Garbled {
        /// Which way.
        way: &'static str,
        /// Of the words sent.
        expected: u32,
        /// Of the words that arrived.
        found: u32,
    },
    /// Words of the second process's command line.
    #[error("the receiving process: {expected} expected, found `{found}`")]
    Argument {
        /// What belongs there.
        expected: &'static str,
        /// What is there.
        found: String,
    },
    /// A payload that its topic cannot carry.
    #[error("payload: 1 to {limit} bytes expected, found {found}")]
    PayloadSize {
        /// Largest message of the topic.
        limit: usize,
        /// As asked for.
        found: usize,
    },
}

impl TransportError {
    pub(crate) fn io(action: &'static str) -> impl FnOnce(std::io::Error) -> TransportError {
        move |source| TransportError::Io { action, source }
    }

    pub(crate) fn port<E: std::fmt::Debug>(
        action: &'static str,
    ) -> impl FnOnce(E) -> TransportError {
        move |cause| TransportError::Port {
            action,
            cause: format!("{cause:?}"),
        }
    }
}
