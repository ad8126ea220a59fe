//! Removing what an instance left in shared memory.

use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use crate::Instance;
use crate::instance::SHARED_MEMORY;

/// Paths of the instance's segments.
fn segments(instance: &Instance) -> Vec<PathBuf> {
    let is_ours = |name: OsString| name.to_string_lossy().starts_with(instance.prefix());
    let entries = entries(Path::new(SHARED_MEMORY)).filter(|entry| is_ours(entry.file_name()));
    entries.map(|entry| entry.path()).collect()
}

fn entries(folder: &Path) -> impl Iterator<Item = fs::DirEntry> {
    fs::read_dir(folder).into_iter().flatten().flatten()
}

/// Removes all segments, and all of the root folder but the file named `keep`. Only for the one process that is alone.
/// Returns how many things there were.
pub(crate) fn wipe(instance: &Instance, keep: &str) -> usize {
    let mut count = 0;
    for path in segments(instance) {
        count += usize::from(fs::remove_file(path).is_ok());
    }
    for entry in entries(instance.root()).filter(|entry| entry.file_name() != keep) {
        let path = entry.path();
        let removed = if path.is_dir() {
            fs::remove_dir_all(&path)
        } else {
            fs::remove_file(&path)
        };
        count += usize::from(removed.is_ok());
    }
    count
}

/// A connection that is being made has 0 bytes for microseconds; one that has them for so long belongs to a process
/// that was killed there.
const STILLBORN_AGE: Duration = Duration::from_millis(200);

/// Removes segments of 0 bytes that a killed process left while it made them: iceoryx2 0.10's cleaning of dead
/// processes would wait on such a connection for ever.
pub(crate) fn sweep_stillborn(instance: &Instance) -> usize {
    let now = SystemTime::now();
    let stillborn = |path: &PathBuf| {
        let about = fs::symlink_metadata(path).ok();
        let empty = about.filter(|about| about.len() == 0);
        let age = empty.and_then(|about| now.duration_since(about.modified().ok()?).ok());
        age.is_some_and(|age| age > STILLBORN_AGE)
    };
    let stillborn = segments(instance).into_iter().filter(stillborn);
    let removed = stillborn.filter(|path| fs::remove_file(path).is_ok());
    removed.count()
}

/// iceoryx2 makes its management segment writable for everybody; one byte from another user would then stop every
/// later start. Only our user keeps access.
pub(crate) fn close_to_others(instance: &Instance) {
    use std::os::unix::fs::PermissionsExt;
    for path in segments(instance) {
        if path.to_string_lossy().ends_with("global_mgmt") {
            // Another process of the instance may remove it at this moment: nothing to do then.
            let _ = fs::set_permissions(&path, fs::Permissions::from_mode(0o600));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_old_empty_segments_of_this_instance_are_stillborn() {
        let name = format!("sweep-{}", std::process::id());
        let instance = Instance::new(&name).unwrap();
        let at = |name: &str| PathBuf::from(format!("{SHARED_MEMORY}/{}{name}", instance.prefix()));
        let now = SystemTime::now();
        let old = now - Duration::from_secs(2);
        for (name, bytes, modified) in [
            ("old.connection", &b""[..], old),
            ("new.connection", b"", now),
            ("full.connection", b"x", old),
        ] {
            fs::write(at(name), bytes).unwrap();
            let file = fs::File::open(at(name)).unwrap();
            file.set_modified(modified).unwrap();
        }
        assert_eq!(sweep_stillborn(&instance), 1);
        assert!(!at("old.connection").exists());
        assert!(at("new.connection").exists() && at("full.connection").exists());
        assert_eq!(wipe(&instance, ".lock"), 2);
        assert!(segments(&instance).is_empty());
    }
}
