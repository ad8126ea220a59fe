//! `--input -`: one file of scans from standard input, stored on the disk while it is used.

use crate::UsageError;
use anyhow::{Context, ensure};
use std::fs::{DirBuilder, File, read_dir, remove_dir_all, rename};
use std::io::{IsTerminal, Read, copy, stdin};
use std::{os::unix::fs::DirBuilderExt, path::Path, path::PathBuf};

/// Limit of the input's size, bytes: an hour of a fast sensor.
const BYTES_MAX: u64 = 64 << 30;
/// The first bytes of each kind of file, and its ending; KITTI's `.bin` has no such mark.
const BEGINNINGS: [(&[u8], &str); 11] = [
    (b"\x0A\x0D\x0D\x0A", "pcapng"),
    (b"\xD4\xC3\xB2\xA1", "pcap"),
    (b"\xA1\xB2\xC3\xD4", "pcap"),
    (b"\x4D\x3C\xB2\xA1", "pcap"),
    (b"\xA1\xB2\x3C\x4D", "pcap"),
    (b"\x89MCAP", "mcap"),
    (b"\x93NUMPY", "npy"),
    (b"ply", "ply"),
    (b"LASF", "las"),
    (b"# .PCD", "pcd"),
    (b"VERSION", "pcd"),
];

/// A folder of this process with the file; removed when dropped.
pub(crate) struct Piped(PathBuf);

impl Piped {
    /// Reads standard input to its end where `input` is `-`, which becomes the file's path.
    pub(crate) fn take(input: &mut Option<PathBuf>) -> anyhow::Result<Option<Piped>> {
        if input.as_deref() != Some(Path::new("-")) {
            return Ok(None);
        }
        if stdin().is_terminal() {
            let text = "input -: expected a file on standard input, found a terminal";
            return Err(UsageError(text.into()).into());
        }
        let (place, stem) = (std::env::temp_dir(), "mluc-stdin-");
        // Removes folders of dead processes: a signal while standard input is read ends a process at once, and releases its lock.
        for entry in read_dir(&place).into_iter().flatten().flatten() {
            let (name, path) = (entry.file_name(), entry.path());
            let is_ours = name.to_string_lossy().starts_with(stem) && path.is_dir();
            if is_ours && File::open(&path).is_ok_and(|left| left.try_lock().is_ok()) {
                let _ = remove_dir_all(path);
            }
        }
        let folder = place.join(format!("{stem}{}", std::process::id()));
        let about = || format!("input -: {}", folder.display());
        // No other process finds the folder before it is locked.
        let hidden = place.join(format!(".{stem}{}", std::process::id()));
        let _ = remove_dir_all(&hidden);
        DirBuilder::new().mode(0o700).create(&hidden).with_context(about)?;
        let lock = File::open(&hidden).with_context(about)?;
        let _ = lock.try_lock();
        rename(&hidden, &folder).with_context(about)?;
        let piped = Piped(folder.clone());
        // Locked until this process ends.
        std::mem::forget(lock);
        let mut head = Vec::new();
        stdin().take(16).read_to_end(&mut head).with_context(about)?;
        let mark = BEGINNINGS.iter().find(|(mark, _)| head.starts_with(mark));
        let ending = mark.map_or("bin", |(_, ending)| ending);
        let path = folder.join(format!("stdin.{ending}"));
        let mut file = File::create_new(&path).with_context(about)?;
        let mut limited = head.as_slice().chain(stdin().lock()).take(BYTES_MAX);
        let bytes = copy(&mut limited, &mut file).with_context(about)?;
        ensure!(bytes < BYTES_MAX, "input -: expected less than {BYTES_MAX} bytes, found more");
        ensure!(bytes > 0, "input -: expected a file on standard input, found nothing");
        *input = Some(path);
        Ok(Some(piped))
    }
}

impl Drop for Piped {
    fn drop(&mut self) {
        let _ = remove_dir_all(&self.0);
    }
}
