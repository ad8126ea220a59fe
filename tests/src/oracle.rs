//! Answers from outside.

use std::path::PathBuf;

use crate::skip::data_folder;

/// The folder of answers; see [`data_folder`].
pub fn oracle() -> Option<PathBuf> {
    data_folder("MLUC_ORACLE")
}
