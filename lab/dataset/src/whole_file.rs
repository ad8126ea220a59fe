//! Files that are written completely or not at all: written next to their place, synced to disk, then moved.

use std::{fs::File, io::Write, path::Path, path::PathBuf};

/// Writes a file. A crash or a full disk leaves the old file in place: the bytes are synced to disk (some file systems report a full disk
/// only then) before the move. The error is the system's; the partial file is removed.
///
/// A link stays, and the file that it leads to is replaced. Bytes for a pipe or a device are written directly.
pub fn write_whole(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let path = &path.canonicalize().unwrap_or(path.to_owned());
    let is_file = std::fs::metadata(path).is_ok_and(|there| there.is_file() || there.is_dir());
    if path.exists() && !is_file {
        return std::fs::write(path, bytes);
    }
    let beside = beside(path);
    let written = File::create(&beside).and_then(|mut file| {
        file.write_all(bytes)?;
        file.sync_all()?;
        std::fs::rename(&beside, path)
    });
    if written.is_err() {
        // Best effort: the error to report is the first one.
        let _ = std::fs::remove_file(&beside);
        return written;
    }
    // Syncs the move itself. Some file systems do not support this, and after a crash the old file would still be valid.
    if let Some(Ok(folder)) = path.parent().map(File::open) {
        let _ = folder.sync_all();
    }
    Ok(())
}

/// Path where a file is written before it is moved to its place: `.NAME.partial` in the same folder.
pub fn beside(path: &Path) -> PathBuf {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!(".{name}.partial"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_takes_the_place_of_another_and_leaves_nothing_beside() {
        let folder = tempfile::tempdir().expect("a folder");
        let [file, link] = ["a.b", "link"].map(|name| folder.path().join(name));
        for bytes in [b"one".as_slice(), b"two"] {
            write_whole(&file, bytes).expect("written");
            assert_eq!(std::fs::read(&file).expect("there"), bytes);
        }
        // A link stays a link.
        std::os::unix::fs::symlink(&file, &link).expect("a link");
        write_whole(&link, b"new").expect("written");
        assert!(link.is_symlink());
        assert_eq!(std::fs::read(&file).expect("there"), b"new");
        let files = std::fs::read_dir(folder.path()).expect("a folder").count();
        assert_eq!(files, 2);
    }

    #[test]
    fn what_cannot_take_its_place_leaves_the_old_one() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a");
        std::fs::create_dir_all(path.join("inner")).expect("a folder in the way");
        assert!(write_whole(&path, b"bytes").is_err());
        assert!(path.join("inner").is_dir() && !beside(&path).exists());
        assert!(write_whole(&folder.path().join("none/a"), b"bytes").is_err());
        // The partial file cannot be written, as on a full disk.
        let file = folder.path().join("b");
        write_whole(&file, b"old").expect("written");
        std::fs::create_dir(beside(&file)).expect("a folder in the way");
        assert!(write_whole(&file, b"new").is_err());
        assert_eq!(std::fs::read(&file).expect("there"), b"old");
    }
}
