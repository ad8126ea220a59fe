//! The folder of a run: only one run at a time writes to it, and no run overwrites a model that it did not make.

use crate::error::{TrainError, refused};
use mluc_dataset::whole_file::write_whole;
use std::{fs::File, fs::TryLockError, path::Path};

/// Creates the folder and locks it for this process, as long as the file is open.
pub fn enter(out: &Path) -> Result<File, TrainError> {
    std::fs::create_dir_all(out).map_err(|cause| TrainError::file(out, cause))?;
    let path = out.join(".lock");
    let mut options = File::options();
    let file = options.create(true).truncate(false).write(true).open(&path);
    let file = file.map_err(|cause| TrainError::file(&path, cause))?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => Err(refused(
            out,
            "a folder of no other run",
            "another run writing into it; wait for it, or name another folder",
        )),
        Err(TryLockError::Error(cause)) => Err(TrainError::file(&path, cause)),
    }
}

/// For a new run: refuses a folder that contains a file of another run.
pub(crate) fn refuse_other(out: &Path, file: &str) -> Result<(), TrainError> {
    let path = out.join(file);
    if path.exists() {
        let expected = "no file of another run (its checkpoint is missing, or is of another kind)";
        let found = "one; move it away or name another folder";
        return Err(refused(&path, expected, found));
    }
    Ok(())
}

/// Writes a file of the run: after a crash or with a full disk the old file stays.
pub(crate) fn write(path: &Path, bytes: &[u8]) -> Result<(), TrainError> {
    write_whole(path, bytes).map_err(|cause| TrainError::file(path, cause))
}
