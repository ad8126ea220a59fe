//! Removing what an instance left in shared memory.

use std::fs;
use std::path::PathBuf;
use std::time::{Duration, SystemTime};

use crate::Instance;
use crate::instance::SHARED_MEMORY;

/// Paths of the instance's segments.
fn segments(instance: &Instance) -> Vec<PathBuf> {
    let Ok(entries) = fs::read_dir(SHARED_MEMORY) else {
        return Vec::new();
    };
    entries
        .flatten()
        .filter(|entry| {
            let name = entry.file_name();
            name.to_string_lossy().starts_with(instance.prefix())
        })
        .map(|entry| entry.path())
        .collect()
}

/// Removes all segments, and all of the root folder but the file named `keep`. Only for the one process that is alone.
/// Returns how many things there were.
pub(crate) fn wipe(instance: &Instance, keep: &str) -> usize {
    let mut count = 0;
    for path in segments(instance) {
        count += usize::from(fs::remove_file(path).is_ok());
    }
    for entry in fs::read_dir(instance.root())
        .into_iter()
        .flatten()
        .flatten()
    {
        if entry.file_name() == keep {
            continue;
        }
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
        let Ok(about) = fs::symlink_metadata(path) else {
            return false;
        };
        let age = about
            .modified()
            .ok()
            .and_then(|at| now.duration_since(at).ok());
        about.len() == 0 && age.is_some_and(|age| age > STILLBORN_AGE)
    };
    segments(instance)
        .into_iter()
        .filter(stillborn)
        .filter(|path| fs::remove_file(path).is_ok())
        .count()
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
        let at =
            |suffix: &str| PathBuf::from(format!("{SHARED_MEMORY}/{}{suffix}", instance.prefix()));
        let old = SystemTime::now() - Duration::from_secs(2);
        fs::write(at("old.connection"), b"").unwrap();
        fs::File::open(at("old.connection"))
            .unwrap()
            .set_modified(old)
            .unwrap();
        fs::write(at("new.connection"), b"").unwrap();
        fs::write(at("full.connection"), b"x").unwrap();
        fs::File::open(at("full.connection"))
            .unwrap()
            .set_modified(old)
            .unwrap();

        assert_eq!(sweep_stillborn(&instance), 1);
        assert!(!at("old.connection").exists());
        assert!(at("new.connection").exists() && at("full.connection").exists());
        assert_eq!(wipe(&instance, ".lock"), 2);
        assert!(segments(&instance).is_empty());
    }
}
