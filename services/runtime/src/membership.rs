//! Who lives in an instance: locks that the kernel releases when a process dies, however it dies.
//!
//! Each process holds `.lock` in the root folder shared. Whoever gets it exclusively is alone: at the start it wipes
//! what a crash left, at the end it removes everything. So nothing stays in shared memory, in any order of leaving.

use std::fs::{self, File, OpenOptions};
use std::io::{Read, Write};
use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt};
use std::path::Path;
use std::time::{Duration, Instant};

use mluc_ipc_types::WIRE_VERSION;
use rustix::fs::{FlockOperation, flock};
use rustix::process::{Pid, getppid};

use crate::error::Result;
use crate::{Instance, RuntimeError, sweep};

const LOCK: &str = ".lock";
const CONTRACT: &str = "contract";
const OUR_VERSION: &str = env!("CARGO_PKG_VERSION");
/// Another process wipes or writes the contract for milliseconds; a guess with room.
const PATIENCE: Duration = Duration::from_secs(5);
/// A killed parent's threads may hold its lock for a moment after its children heard of its death.
const ORPHAN_PATIENCE: Duration = Duration::from_millis(500);

/// This process lives in the instance. Drop it last: it removes all files when nobody else is there.
#[derive(Debug)]
pub struct Membership {
    instance: Instance,
    lock: File,
    parent: Option<Pid>,
}

impl Membership {
    /// Joins; `role` is told to those who come later.
    pub fn join(instance: &Instance, role: &str) -> Result<Membership> {
        let begun = Instant::now();
        loop {
            if let Some(lock) = Membership::try_join(instance, role)? {
                let member = Membership {
                    instance: instance.clone(),
                    lock,
                    parent: getppid(),
                };
                member.check_contract()?;
                return Ok(member);
            }
            if begun.elapsed() > PATIENCE {
                let cause = format!("joining: {} stays locked", instance.root().display());
                return Err(RuntimeError::instance(instance.name(), cause));
            }
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    /// One try; `None`: the folder was just removed or is being wiped.
    fn try_join(instance: &Instance, role: &str) -> Result<Option<File>> {
        let root = instance.root();
        fs::DirBuilder::new()
            .recursive(true)
            .mode(0o700)
            .create(root)
            .map_err(RuntimeError::io("creating", root))?;
        let path = root.join(LOCK);
        let lock = match open_lock(&path) {
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            opened => opened.map_err(RuntimeError::io("opening", &path))?,
        };
        if flock(&lock, FlockOperation::NonBlockingLockExclusive).is_ok() {
            if !is_same_file(&lock, &path) {
                return Ok(None);
            }
            let count = sweep::wipe(instance, LOCK);
            if count > 0 {
                tracing::info!(count, "removed what an earlier run left in shared memory");
            }
            write_contract(instance, role)?;
        }
        let shared = flock(&lock, FlockOperation::NonBlockingLockShared).is_ok();
        Ok((shared && is_same_file(&lock, &path)).then_some(lock))
    }

    fn check_contract(&self) -> Result<()> {
        let path = self.instance.root().join(CONTRACT);
        // Whoever was alone wrote it before anybody else could share the lock.
        let text = fs::read_to_string(&path).map_err(RuntimeError::io("reading", &path))?;
        let field = |key: &str| {
            let mut words = text.split_whitespace();
            words.find_map(|word| word.strip_prefix(key)).unwrap_or("?")
        };
        if field("wire=").parse() == Ok(WIRE_VERSION) {
            return Ok(());
        }
        let cause = format!(
            "it speaks wire version {} (mluc {}, begun by {}, process {}); this is mluc {OUR_VERSION} with wire version \
             {WIRE_VERSION}: stop the other one, run the same mluc on both sides, or choose another --instance",
            field("wire="),
            field("version="),
            field("by="),
            field("pid="),
        );
        Err(RuntimeError::instance(self.instance.name(), cause))
    }

    /// Takes a role that only one process may have (`pipeline`, `backbone`); released when the claim is dropped or the
    /// process dies.
    pub fn claim(&self, role: &str) -> Result<Claim> {
        let path = self.instance.root().join(format!("{role}.pid"));
        let mut file = open_lock(&path).map_err(RuntimeError::io("opening", &path))?;
        if flock(&file, FlockOperation::NonBlockingLockExclusive).is_err() {
            let mut pid = String::new();
            let _ = file.read_to_string(&mut pid);
            let pid = pid.split_whitespace().next().unwrap_or("?");
            return Err(RuntimeError::AlreadyRunning {
                role: role.to_string(),
                instance: self.instance.name().to_string(),
                pid: pid.to_string(),
            });
        }
        file.set_len(0)
            .and_then(|()| writeln!(file, "{}", std::process::id()))
            .map_err(RuntimeError::io("writing", &path))?;
        Ok(Claim { _file: file })
    }
}

impl Drop for Membership {
    fn drop(&mut self) {
        let begun = Instant::now();
        while flock(&self.lock, FlockOperation::NonBlockingLockExclusive).is_err() {
            let is_orphan = getppid() != self.parent;
            if !is_orphan || begun.elapsed() > ORPHAN_PATIENCE {
                return;
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        let path = self.instance.root().join(LOCK);
        if is_same_file(&self.lock, &path) {
            sweep::wipe(&self.instance, LOCK);
            let _ = fs::remove_file(&path);
            let _ = fs::remove_dir(self.instance.root());
        }
    }
}

/// A role that this process has alone.
#[derive(Debug)]
pub struct Claim {
    _file: File,
}

fn open_lock(path: &Path) -> std::io::Result<File> {
    OpenOptions::new()
        .read(true)
        .write(true)
        .create(true)
        .truncate(false)
        .mode(0o600)
        .open(path)
}

/// Whether the path still leads to this open file: the last process of an instance removes it.
fn is_same_file(file: &File, path: &Path) -> bool {
    let id = |about: fs::Metadata| (about.ino(), about.dev());
    let ids = [file.metadata(), fs::metadata(path)].map(|about| about.map(id).ok());
    ids[0].is_some() && ids[0] == ids[1]
}

fn write_contract(instance: &Instance, role: &str) -> Result<()> {
    let path = instance.root().join(CONTRACT);
    let pid = std::process::id();
    let text = format!("wire={WIRE_VERSION} version={OUR_VERSION} by={role} pid={pid}\n");
    fs::write(&path, text).map_err(RuntimeError::io("writing", &path))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn instance(label: &str) -> Instance {
        Instance::new(&format!("{label}-{}", std::process::id())).unwrap()
    }

    #[test]
    fn the_last_one_removes_everything() {
        let instance = instance("last");
        let first = Membership::join(&instance, "a").unwrap();
        let second = Membership::join(&instance, "b").unwrap();
        let segment = format!("/dev/shm/{}x.data", instance.prefix());
        fs::write(&segment, b"x").unwrap();
        drop(first);
        assert!(instance.root().exists() && Path::new(&segment).exists());
        drop(second);
        assert!(!instance.root().exists() && !Path::new(&segment).exists());
    }

    #[test]
    fn the_first_one_wipes_what_a_crash_left() {
        let instance = instance("first");
        fs::create_dir_all(instance.root().join("nodes")).unwrap();
        let segment = format!("/dev/shm/{}x.data", instance.prefix());
        fs::write(&segment, b"x").unwrap();
        let member = Membership::join(&instance, "a").unwrap();
        assert!(!Path::new(&segment).exists());
        assert!(!instance.root().join("nodes").exists());
        drop(member);
    }

    #[test]
    fn a_role_is_taken_once() {
        let instance = instance("role");
        let member = Membership::join(&instance, "a").unwrap();
        let claim = member.claim("pipeline").unwrap();
        let error = member.claim("pipeline").unwrap_err().to_string();
        assert!(error.contains(&std::process::id().to_string()), "{error}");
        assert!(error.contains("--instance"), "{error}");
        drop(claim);
        assert!(member.claim("pipeline").is_ok());
    }

    #[test]
    fn another_wire_version_is_named() {
        let instance = instance("wire");
        let member = Membership::join(&instance, "a").unwrap();
        let path = instance.root().join(CONTRACT);
        fs::write(&path, "wire=9 version=3.0.0 by=ingest pid=77\n").unwrap();
        let error = Membership::join(&instance, "b").unwrap_err().to_string();
        let ours = format!("wire version {WIRE_VERSION}");
        for part in ["wire version 9", "mluc 3.0.0", "ingest", "77", &ours] {
            assert!(error.contains(part), "{part}: {error}");
        }
        drop(member);
    }
}
