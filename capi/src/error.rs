//! Errors as codes; each thread keeps the message of its last error.

use mluc_ipc_types::ContractError;
use mluc_runtime::RuntimeError;
use std::{cell::RefCell, ffi::CString, ffi::c_char};

/// What a call returns. Negative: an error, and `mluc_last_error` says more.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(i32)]
pub enum Code {
    /// Done; of `mluc_refiner_wait`: a frame came.
    Ok = 0,
    /// No frame came within the timeout.
    Timeout = 1,
    /// The process was asked to end (SIGTERM, SIGINT): close and return from `main` with 0.
    Stopping = 2,
    /// A null pointer, or a call at the wrong time, such as publish before wait.
    Usage = -1,
    /// The instance could not be joined: another wire version, a refiner runs already, shared memory is full.
    Open = -2,
    /// What was to be published breaks the contract; nothing was published.
    Contract = -3,
    /// Shared memory failed.
    Memory = -4,
    /// A bug in this library.
    Internal = -5,
}

/// An error with its message.
#[derive(Debug)]
pub(crate) struct Failure {
    pub(crate) code: Code,
    pub(crate) words: String,
}

impl Failure {
    pub(crate) fn new(code: Code, words: impl ToString) -> Failure {
        let words = words.to_string();
        Failure { code, words }
    }
}

impl From<RuntimeError> for Failure {
    fn from(error: RuntimeError) -> Failure {
        Failure::new(Code::Memory, error)
    }
}

impl From<ContractError> for Failure {
    fn from(error: ContractError) -> Failure {
        Failure::new(Code::Contract, error)
    }
}

thread_local! {
    static LAST: RefCell<CString> = RefCell::default();
}

/// Keeps the message for `mluc_last_error`.
pub(crate) fn remember(words: &str) {
    let words = CString::new(words.replace('\0', " ")).unwrap_or_default();
    // It only fails while the thread ends: then nobody reads the message.
    let _ = LAST.try_with(|last| last.replace(words));
}

/// The last message; valid until the next failing call of this thread.
pub(crate) fn last() -> *const c_char {
    LAST.try_with(|last| last.borrow().as_ptr()).unwrap_or(c"".as_ptr())
}
