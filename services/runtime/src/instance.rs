//! One pipeline on this machine: its name and the paths of its files.
//!
//! Everything of an instance is in `/dev/shm`: the folder [`Instance::root`], `/dev/shm/mluc-UID-NAME` (locks, iceoryx2's small files), and the segments whose
//! names begin with [`Instance::prefix`], `mluc-UID-NAME.`. On a tmpfs iceoryx2 finds a dead process through files three times faster than on a disk.

use crate::{RuntimeError, error::Result};
use std::path::{Path, PathBuf};

/// Where POSIX shared memory lies on Linux.
pub(crate) const SHARED_MEMORY: &str = "/dev/shm";

/// A pipeline's name and paths.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Instance {
    name: String,
    prefix: String,
    root: PathBuf,
}

impl Instance {
    /// The name when none is given.
    pub const DEFAULT: &str = "default";
    /// Longest name and user's number together: each stands twice in a socket path, which has at most 107 bytes.
    const NAME_MAX: usize = 24;

    /// Checks the name.
    pub fn new(name: &str) -> Result<Instance> {
        let user = rustix::process::geteuid().as_raw().to_string();
        let most = Instance::NAME_MAX - user.len();
        let fits = (1..=most).contains(&name.len());
        let plain = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
        if !fits || !name.chars().all(plain) {
            let cause = format!("its name must be 1 to {most} of a-z, A-Z, 0-9, '-' and '_'");
            return Err(RuntimeError::instance(name, cause));
        }
        // A dot ends the name, so that no instance's prefix begins another's.
        let stem = format!("mluc-{user}-{name}");
        Ok(Instance {
            name: name.to_string(),
            prefix: format!("{stem}."),
            root: Path::new(SHARED_MEMORY).join(stem),
        })
    }

    /// The name as it was given.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The start of the names of its segments in `/dev/shm`.
    pub fn prefix(&self) -> &str {
        &self.prefix
    }

    /// The folder of its small files.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Environment variable with the instance's name. A foreign stage needs nothing else: prefix and root path follow from the
    /// name and the user id, and the topic `run` gives the model and its classes.
    pub const VARIABLE: &str = "MLUC_INSTANCE";

    /// The instance that the environment names, else the default one.
    pub fn from_environment() -> Result<Instance> {
        match std::env::var(Instance::VARIABLE) {
            Ok(name) if !name.is_empty() => Instance::new(&name),
            _ => Instance::new(Instance::DEFAULT),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_could_leave_the_folder_are_refused() {
        let long = "x".repeat(25);
        for name in ["", ".", "..", "a/b", "a.b", "a b", "\u{e4}", &long] {
            assert!(Instance::new(name).is_err(), "{name:?}");
        }
        assert!(Instance::new(&"x".repeat(14)).is_ok());
    }

    #[test]
    fn no_prefix_begins_another() {
        let (short, long) = (Instance::new("a").unwrap(), Instance::new("a-b").unwrap());
        assert!(!long.prefix().starts_with(short.prefix()));
    }
}
