//! Measurements of mluc: the program `mluc-bench`, and what the other measuring programs of this folder share.

mod machine;
mod report;
mod run;

use std::path::Path;

use anyhow::{Context, Result};
pub use run::program;

/// Writes a file into a folder of results, which is made when missing.
pub fn save(folder: &Path, name: &str, bytes: impl AsRef<[u8]>) -> Result<()> {
    let path = folder.join(name);
    let made = std::fs::create_dir_all(folder);
    let written = made.and_then(|()| std::fs::write(&path, bytes));
    written.with_context(|| format!("writing {}", path.display()))
}
