//! Removing what an instance left in shared memory.

use crate::{Instance, RuntimeError, error::Result, instance::SHARED_MEMORY};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};
use std::{collections::HashSet, ffi::OsString, fs, io::ErrorKind, os::unix::fs::OpenOptionsExt};

/// Paths of the instance's segments.
fn segments(instance: &Instance) -> Vec<PathBuf> {
    let is_ours = |name: OsString| name.to_string_lossy().starts_with(instance.prefix());
    let entries = entries(Path::new(SHARED_MEMORY)).filter(|entry| is_ours(entry.file_name()));
    entries.map(|entry| entry.path()).collect()
}

fn entries(folder: &Path) -> impl Iterator<Item = fs::DirEntry> {
    fs::read_dir(folder).into_iter().flatten().flatten()
}

/// Removes all segments, and all of the root folder except the file named `keep`. Only for a process that is alone. Returns the number removed.
pub(crate) fn wipe(instance: &Instance, keep: &str) -> usize {
    let inner = entries(instance.root()).filter(|entry| entry.file_name() != keep);
    let paths = segments(instance).into_iter();
    let paths = paths.chain(inner.map(|entry| entry.path()));
    let remove = |path: &PathBuf| fs::remove_file(path).or_else(|_| fs::remove_dir_all(path));
    paths.filter(|path| remove(path).is_ok()).count()
}

/// Called after a wipe. A segment that is still there belongs to another user, who may have put it there on purpose: an error.
pub(crate) fn check_empty(instance: &Instance) -> Result<()> {
    let Some(path) = segments(instance).into_iter().next() else {
        return Ok(());
    };
    let cause = format!(
        "{} cannot be removed: another user's; have it removed, or choose another --instance",
        path.display()
    );
    Err(RuntimeError::instance(instance.name(), cause))
}

/// Removes segments of 0 bytes, left by a process that was killed while it made them: iceoryx2 0.10's cleaning of dead
/// processes would wait on such a connection for ever. The maker of a segment keeps it open until it has its size, so the maker of
/// an empty segment that no process has open is dead. (The processes of an instance must see each other in `/proc`.)
pub(crate) fn sweep_stillborn(instance: &Instance) -> usize {
    let is_empty = |path: &PathBuf| fs::symlink_metadata(path).is_ok_and(|about| about.len() == 0);
    let mut empty = segments(instance);
    empty.retain(is_empty);
    if empty.is_empty() {
        return 0;
    }
    let open = open_segments();
    let stillborn = empty.into_iter().filter(|path| !open.contains(path) && is_empty(path));
    stillborn.filter(|path| fs::remove_file(path).is_ok()).count()
}

/// Files of shared memory that some process has open.
fn open_segments() -> HashSet<PathBuf> {
    let descriptors = entries(Path::new("/proc")).flat_map(|process| {
        let folder = process.path().join("fd");
        entries(&folder).collect::<Vec<_>>()
    });
    let paths = descriptors.filter_map(|descriptor| fs::read_link(descriptor.path()).ok());
    paths.filter(|path| path.starts_with(SHARED_MEMORY)).collect()
}

/// iceoryx2 0.10 makes its management segment writable for everybody, and one byte from another user would stop every later start.
/// This makes it first, for this user alone and with its content (version 0.10.0, no node counted), so that iceoryx2 only opens it.
pub(crate) fn make_management_segment(instance: &Instance) -> Result<()> {
    // iceoryx2 puts a hash of the content's type before its own name.
    const NAME: &str = "9204dd183d1c4d8e1ff592a30766ffa6765aa8b5_node.0_10_0.global_mgmt";
    const VERSION: u64 = 10 << 16;
    let path = PathBuf::from(format!("{SHARED_MEMORY}/{}{NAME}", instance.prefix()));
    let failed = || RuntimeError::io("making", &path);
    // It appears under its name only when it is complete, and never replaces another one. Two threads may make it at the same time.
    static CALLS: AtomicU32 = AtomicU32::new(0);
    let call = CALLS.fetch_add(1, Ordering::Relaxed);
    let own = format!("management.{}.{call}", std::process::id());
    let own = instance.root().join(own);
    let mut options = fs::OpenOptions::new();
    options.write(true).create(true).truncate(true).mode(0o600);
    let file = options.open(&own);
    let content = [VERSION, 0].map(u64::to_ne_bytes).concat();
    file.and_then(|mut file| std::io::Write::write_all(&mut file, &content)).map_err(failed())?;
    let linked = fs::hard_link(&own, &path);
    let _ = fs::remove_file(&own);
    match linked {
        Err(e) if e.kind() == ErrorKind::AlreadyExists => check_owner(&path),
        linked => linked.map_err(failed()),
    }
}

/// Refuses a segment of another user, or a link: another user who made it in the meantime could write what this process reads.
fn check_owner(path: &Path) -> Result<()> {
    use std::os::unix::fs::MetadataExt;
    let about = fs::symlink_metadata(path).map_err(RuntimeError::io("looking at", path))?;
    let is_ours = about.uid() == rustix::process::geteuid().as_raw() && about.is_file();
    let theirs = || std::io::Error::new(ErrorKind::PermissionDenied, "it is another user's");
    is_ours.then_some(()).ok_or_else(theirs).map_err(RuntimeError::io("using", path))
}

/// Closes a management segment to other users if iceoryx2 made it under another name.
pub(crate) fn close_to_others(instance: &Instance) {
    use std::os::unix::fs::PermissionsExt;
    let mut management = segments(instance);
    management.retain(|path| path.to_string_lossy().ends_with("global_mgmt"));
    for path in management {
        // Another process of the instance may remove it at this moment: nothing to do then.
        let _ = fs::set_permissions(&path, fs::Permissions::from_mode(0o600));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn empty_segments_of_this_instance_that_nobody_holds_are_stillborn() {
        let name = format!("sweep-{}", std::process::id());
        let instance = Instance::new(&name).unwrap();
        let at = |name: &str| PathBuf::from(format!("{SHARED_MEMORY}/{}{name}", instance.prefix()));
        for (name, bytes) in [("dead", &b""[..]), ("being-made", b""), ("full", b"x")] {
            fs::write(at(name), bytes).unwrap();
        }
        let held = fs::File::open(at("being-made")).unwrap();
        assert_eq!(sweep_stillborn(&instance), 1);
        assert!(!at("dead").exists());
        assert!(at("being-made").exists() && at("full").exists());
        drop(held);
        assert!(check_empty(&instance).is_err());
        assert_eq!(wipe(&instance, ".lock"), 2);
        assert!(check_empty(&instance).is_ok());
    }

    #[test]
    fn threads_that_make_the_management_segment_at_once_all_succeed() {
        let instance = Instance::new(&format!("at-once-{}", std::process::id())).unwrap();
        fs::create_dir(instance.root()).unwrap();
        std::thread::scope(|scope| {
            for _ in 0..8 {
                scope.spawn(|| (0..200).for_each(|_| make_management_segment(&instance).unwrap()));
            }
        });
        assert_eq!(wipe(&instance, ""), 1, "the segment alone is there");
        fs::remove_dir(instance.root()).unwrap();
    }
}
