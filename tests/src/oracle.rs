//! Answers from outside.

use std::path::PathBuf;

/// The folder of answers, or `None` when the variable is not set; set and missing is a failure.
pub fn oracle() -> Option<PathBuf> {
    let Some(folder) = std::env::var_os("MLUC_ORACLE") else {
        println!("skipped: MLUC_ORACLE not set");
        return None;
    };
    let folder = PathBuf::from(folder);
    assert!(
        folder.is_dir(),
        "MLUC_ORACLE: expected a folder, found {}",
        folder.display()
    );
    Some(folder)
}
