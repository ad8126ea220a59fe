//! The processes of an instance: locks that the kernel releases when a process dies, for whatever reason.
//!
//! Each process has a shared lock on `.lock` in the root folder. A process that gets an exclusive lock is alone: at its start it
//! removes what a crash left, at its end it removes everything. So nothing stays in shared memory, in whatever order processes end.

use crate::{Instance, RuntimeError, error::Result, mapping::mappings, sweep};
use mluc_ipc_types::WIRE_VERSION;
use rustix::fs::{FlockOperation, OFlags, flock};
use rustix::process::{Pid, geteuid, getppid};
use std::os::unix::fs::{DirBuilderExt, FileExt, MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use std::{fs, fs::File, fs::OpenOptions, io::ErrorKind};

const LOCK: &str = ".lock";
const CONTRACT: &str = "contract";
const OUR_VERSION: &str = env!("CARGO_PKG_VERSION");
/// Limit of the wait for another process that cleans up or writes the contract. That takes milliseconds; the limit is a generous guess.
const PATIENCE: Duration = Duration::from_secs(5);
/// The threads of a killed parent may keep its lock for a moment after its children are notified of its death.
const ORPHAN_PATIENCE: Duration = Duration::from_millis(500);

/// Membership of this process in the instance. Drop it last: it removes all files if no other process is a member.
#[derive(Debug)]
pub struct Membership {
    instance: Instance,
    lock: File,
    parent: Option<Pid>,
}

impl Membership {
    /// Joins the instance. The first process writes its `role` into the contract for the processes that join later.
    pub fn join(instance: &Instance, role: &str) -> Result<Membership> {
        let begun = Instant::now();
        loop {
            if let Some(lock) = Membership::try_join(instance, role)? {
                let member = Membership { instance: instance.clone(), lock, parent: getppid() };
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
        match fs::DirBuilder::new().mode(0o700).create(root) {
            Err(e) if e.kind() == ErrorKind::AlreadyExists => (),
            made => made.map_err(RuntimeError::io("creating", root))?,
        }
        if !is_ours_alone(instance)? {
            return Ok(None);
        }
        let path = root.join(LOCK);
        let lock = match open_lock(&path) {
            Err(e) if e.kind() == ErrorKind::NotFound => return Ok(None),
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
            sweep::check_empty(instance)?;
            let contract = root.join(CONTRACT);
            let pid = std::process::id();
            let text = format!("wire={WIRE_VERSION} version={OUR_VERSION} by={role} pid={pid}\n");
            fs::write(&contract, text).map_err(RuntimeError::io("writing", &contract))?;
        }
        let shared = flock(&lock, FlockOperation::NonBlockingLockShared).is_ok();
        Ok((shared && is_same_file(&lock, &path)).then_some(lock))
    }

    fn check_contract(&self) -> Result<()> {
        let path = self.instance.root().join(CONTRACT);
        // The first process wrote it under the exclusive lock, before another process could share the lock.
        let text = fs::read_to_string(&path).map_err(RuntimeError::io("reading", &path))?;
        let field = |key: &str| {
            text.split_whitespace().find_map(|word| word.strip_prefix(key)).unwrap_or("?")
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

    /// Takes a role that only one process may have (`pipeline`, `backbone`); released when the claim is dropped or the process dies.
    pub fn claim(&self, role: &str) -> Result<Claim> {
        let path = claim_path(&self.instance, role);
        let file = open_lock(&path).map_err(RuntimeError::io("opening", &path))?;
        if flock(&file, FlockOperation::NonBlockingLockExclusive).is_err() {
            let pid = ClaimNote::read(&self.instance, role).map(|note| note.pid.to_string());
            let (name, pid) = (self.instance.name(), pid.unwrap_or("?".to_string()));
            return Err(RuntimeError::AlreadyRunning(role.into(), name.into(), pid));
        }
        let claim = Claim { file };
        claim.note_frame(None).map_err(RuntimeError::io("writing", &path))?;
        Ok(claim)
    }
}

fn claim_path(instance: &Instance, role: &str) -> PathBuf {
    instance.root().join(format!("{role}.pid"))
}

/// Whether the root folder belongs to this user, and to nobody else; false: it is gone again. In `/dev/shm` another user may have made it: an error.
fn is_ours_alone(instance: &Instance) -> Result<bool> {
    let root = instance.root();
    let about = match fs::symlink_metadata(root) {
        Err(e) if e.kind() == ErrorKind::NotFound => return Ok(false),
        about => about.map_err(RuntimeError::io("looking at", root))?,
    };
    let (uid, mode) = (about.uid(), about.mode() & 0o7777);
    if about.is_dir() && uid == geteuid().as_raw() && mode & 0o077 == 0 {
        return Ok(true);
    }
    let expected = format!("a folder of user {}, mode 700", geteuid().as_raw());
    let kind = ["no folder", "a folder"][usize::from(about.is_dir())];
    let cause = format!(
        "{}: expected {expected}, found {kind} of user {uid}, mode {mode:o}; have it removed, or choose another --instance",
        root.display()
    );
    Err(RuntimeError::instance(instance.name(), cause))
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
        if !mappings(&self.instance).is_empty() {
            // A port that closes after this process left removes files that the next process of the instance has made.
            tracing::error!("a port outlives its shell: drop the ports first");
        }
        let path = self.instance.root().join(LOCK);
        if is_same_file(&self.lock, &path) {
            sweep::wipe(&self.instance, LOCK);
            let _ = fs::remove_file(&path);
            let _ = fs::remove_dir(self.instance.root());
        }
    }
}

/// A role that only this process has. Its file survives a crash: it names the process that had the role and the frame that it was working on.
#[derive(Debug)]
pub struct Claim {
    file: File,
}

impl Claim {
    /// Notes the frame that is being worked on; `None` between two frames. This costs two system calls per frame, about 1 us.
    pub(crate) fn note_frame(&self, sequence: Option<u64>) -> std::io::Result<()> {
        let sequence = sequence.map_or("-".to_string(), |sequence| sequence.to_string());
        let pid = std::process::id();
        let text = format!("{pid:10} {sequence:>20}\n");
        self.file.write_all_at(text.as_bytes(), 0)
    }
}

/// The content of a claim's file: what the last process with the role wrote.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ClaimNote {
    /// Process id.
    pub pid: u32,
    /// The frame that it is, or was, working on.
    pub sequence: Option<u64>,
}

impl ClaimNote {
    /// Reads the note, whether or not the process is alive.
    pub fn read(instance: &Instance, role: &str) -> Option<ClaimNote> {
        let text = fs::read_to_string(claim_path(instance, role)).ok()?;
        let mut words = text.split_whitespace();
        Some(ClaimNote { pid: words.next()?.parse().ok()?, sequence: words.next()?.parse().ok() })
    }

    /// Reads the note if a living process has the role.
    pub fn of_living(instance: &Instance, role: &str) -> Option<ClaimNote> {
        let file = File::open(claim_path(instance, role)).ok()?;
        let is_held = flock(&file, FlockOperation::NonBlockingLockShared).is_err();
        is_held.then(|| ClaimNote::read(instance, role)).flatten()
    }
}

fn open_lock(path: &Path) -> std::io::Result<File> {
    OpenOptions::new()
        .read(true)
        .write(true)
        .create(true)
        .truncate(false)
        .mode(0o600)
        .custom_flags(OFlags::NOFOLLOW.bits() as i32)
        .open(path)
}

/// Whether the path still leads to this open file: the last process of an instance removes the file.
fn is_same_file(file: &File, path: &Path) -> bool {
    let id = |about: fs::Metadata| (about.ino(), about.dev());
    let ids = [file.metadata(), fs::metadata(path)].map(|about| about.map(id).ok());
    ids[0].is_some() && ids[0] == ids[1]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn instance(label: &str) -> Instance {
        Instance::new(&format!("{label}-{}", std::process::id())).unwrap()
    }

    #[test]
    fn a_claim_tells_who_had_it_and_what_it_worked_on() {
        let instance = instance("note");
        let member = Membership::join(&instance, "a").unwrap();
        assert_eq!(ClaimNote::read(&instance, "head"), None);
        let claim = member.claim("head").unwrap();
        let pid = std::process::id();
        for sequence in [None, Some(u64::MAX), Some(7), None] {
            claim.note_frame(sequence).unwrap();
            let note = Some(ClaimNote { pid, sequence });
            assert_eq!(ClaimNote::read(&instance, "head"), note);
            assert_eq!(ClaimNote::of_living(&instance, "head"), note);
        }
        drop(claim);
        assert!(ClaimNote::read(&instance, "head").is_some());
        assert_eq!(ClaimNote::of_living(&instance, "head"), None);
    }

    #[test]
    fn a_root_that_is_not_ours_alone_is_refused() {
        use std::os::unix::fs::{PermissionsExt, symlink};
        let elsewhere = tempfile::tempdir().unwrap();
        let instance = instance("root");
        let root = instance.root();
        let refuses = |words: &str| {
            let error = Membership::join(&instance, "a").unwrap_err().to_string();
            assert!(error.contains(words) && error.contains("mode 700"), "{error}");
        };
        fs::create_dir(root).unwrap();
        fs::set_permissions(root, fs::Permissions::from_mode(0o777)).unwrap();
        refuses("mode 777");
        if geteuid().is_root() {
            fs::set_permissions(root, fs::Permissions::from_mode(0o700)).unwrap();
            std::os::unix::fs::chown(root, Some(65534), None).unwrap();
            refuses("of user 65534");
        }
        fs::remove_dir(root).unwrap();
        symlink(elsewhere.path(), root).unwrap();
        refuses("no folder");
        fs::remove_file(root).unwrap();
        assert_eq!(fs::read_dir(elsewhere.path()).unwrap().count(), 0);
    }
}
