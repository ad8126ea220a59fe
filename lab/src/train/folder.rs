//! The folder of a run: one run at a time writes to it, and none over a model that it did not make.

use std::fs::{File, TryLockError};
use std::path::Path;

use super::error::TrainError;

/// Makes the folder and takes it for this process, as long as the file is open.
pub(super) fn enter(out: &Path) -> Result<File, TrainError> {
    let failed = |path: &Path| {
        let path = path.to_owned();
        move |cause| TrainError::Io { path, cause }
    };
    std::fs::create_dir_all(out).map_err(failed(out))?;
    let path = out.join(".lock");
    let mut options = File::options();
    let file = options.create(true).truncate(false).write(true).open(&path);
    let file = file.map_err(failed(&path))?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => Err(TrainError::Busy {
            path: out.to_owned(),
        }),
        Err(TryLockError::Error(cause)) => Err(failed(&path)(cause)),
    }
}

/// For a run that begins: refuses the folder where a file of another run lies.
pub(super) fn refuse_other(out: &Path, file: &str) -> Result<(), TrainError> {
    let path = out.join(file);
    if !path.exists() {
        return Ok(());
    }
    Err(TrainError::NotOurs { path })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_is_taken_by_one_run_at_a_time() {
        let folder = tempfile::tempdir().expect("a folder");
        let out = folder.path().join("new/run");
        let first = enter(&out).expect("free");
        let fault = enter(&out).expect_err("taken").to_string();
        assert!(fault.contains("another run"), "{fault}");
        drop(first);
        assert!(enter(&out).is_ok());
    }

    #[test]
    fn a_model_of_another_run_is_not_written_over() {
        let folder = tempfile::tempdir().expect("a folder");
        assert!(refuse_other(folder.path(), "model.safetensors").is_ok());
        std::fs::write(folder.path().join("model.safetensors"), b"somebody's").expect("written");
        let fault = refuse_other(folder.path(), "model.safetensors").expect_err("refused");
        assert!(fault.to_string().contains("move it away"), "{fault}");
    }
}
