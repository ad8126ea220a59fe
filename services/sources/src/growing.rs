//! A folder that another program writes scans into: one file per scan, with ascending names. The newest complete file is the next scan.

use crate::{LiveScans, Next, Scan, files::Layout, folder::Folder, folder::scan_files};
use anyhow::{Context, ensure};
use std::time::{Duration, Instant, SystemTime};
use std::{fs, path::Path, path::PathBuf};

/// Prefix of an input that is such a folder.
pub const FOLLOW: &str = "follow:";
/// The newest file is complete when it has not grown for this time. An older file is complete when a newer one exists.
const SETTLED: Duration = Duration::from_millis(50);
/// A folder that has not changed for this time is not read again.
const QUIET: Duration = Duration::from_secs(1);
/// Silence is reported after this time.
const SILENCE: Duration = Duration::from_secs(1);

pub(crate) struct Growing {
    path: PathBuf,
    /// The scan that was loaded last.
    folder: Folder,
    /// The newest file, its size in bytes, and when this size was first seen.
    newest: Option<(PathBuf, u64, Instant)>,
    /// Size that the last loaded scan's file had when it was loaded, bytes.
    bytes: u64,
    heard: Instant,
    /// When the folder last changed, by the clock of its disk, and when this change was seen.
    changed: (Option<SystemTime>, Instant),
}

impl Growing {
    /// Errors: `path` is not a folder.
    pub(crate) fn open(path: &str, layout: &Layout) -> anyhow::Result<Growing> {
        let inner = Path::new(path).join("velodyne");
        let inner = Some(inner).filter(|inner| inner.is_dir());
        let path = inner.unwrap_or_else(|| PathBuf::from(path));
        let name = path.display();
        ensure!(path.is_dir(), "input {FOLLOW}{name}: expected a folder");
        Ok(Growing {
            folder: Folder::of(vec![], layout),
            newest: None,
            bytes: u64::MAX,
            heard: Instant::now(),
            changed: (None, Instant::now()),
            path,
        })
    }

    /// The newest complete scan after the last one, and the number of scans that are skipped for it.
    fn next(&mut self) -> anyhow::Result<Option<(PathBuf, u64)>> {
        let about = || format!("input {FOLLOW}{}", self.path.display());
        let changed = fs::metadata(&self.path).and_then(|about| about.modified());
        let changed = Some(changed.with_context(about)?);
        if self.changed.0 != changed {
            self.changed = (changed, Instant::now());
        }
        let is_quiet = self.newest.is_none() && self.changed.1.elapsed() > QUIET;
        if is_quiet && !self.folder.scans.is_empty() {
            return Ok(None);
        }
        let last = self.folder.scans.first().cloned();
        if let Some(path) = &last
            && bytes(path) > self.bytes
        {
            self.bytes = u64::MAX;
            let (name, hint) = (path.display(), "write it under another name, and rename it");
            tracing::warn!("{name} was read before it was whole: {hint} when it is whole");
        }
        let mut fresh = scan_files(&self.path, last.as_deref())?;
        if !self.has_settled(fresh.last()) {
            fresh.pop();
        }
        let passed = fresh.len().saturating_sub(1) as u64;
        // Scans that existed at the start were not missed.
        let missed = if last.is_some() { passed } else { 0 };
        Ok(fresh.pop().map(|scan| (scan, missed)))
    }

    fn has_settled(&mut self, newest: Option<&PathBuf>) -> bool {
        let now = newest.map(|path| (path.clone(), bytes(path), Instant::now()));
        match (&self.newest, &now) {
            (Some(old), Some(new)) if (&old.0, old.1) == (&new.0, new.1) => {}
            _ => self.newest = now,
        }
        // An empty file is not complete: its writer has only opened it.
        let is_settled =
            |(_, bytes, since): &mut (_, u64, Instant)| *bytes > 0 && since.elapsed() >= SETTLED;
        self.newest.take_if(is_settled).is_some()
    }
}

fn bytes(path: &PathBuf) -> u64 {
    fs::metadata(path).map_or(0, |about| about.len())
}

impl LiveScans for Growing {
    fn load(&mut self, scan: &mut Scan, patience: Duration) -> anyhow::Result<Next> {
        let Some((path, missed)) = self.next()? else {
            std::thread::sleep(patience);
            return Ok(Next::NotYet);
        };
        if self.folder.scans.is_empty() {
            let checked = self.folder.check_columns(std::slice::from_ref(&path));
            checked.with_context(|| format!("input {}", path.display()))?;
        }
        self.bytes = bytes(&path);
        let written = fs::metadata(&path).and_then(|about| about.modified()).ok();
        let written = written.and_then(|at| at.duration_since(SystemTime::UNIX_EPOCH).ok());
        self.folder.scans = vec![path];
        self.folder.load(0, scan);
        scan.received_ns = written.map(|since| since.as_nanos() as u64);
        // Without a stamp of its own, a scan is as old as its file.
        scan.stamp_ns = scan.stamp_ns.or(scan.received_ns);
        scan.missed = missed;
        self.heard = Instant::now();
        Ok(Next::Scan)
    }

    fn silence(&self) -> Option<String> {
        let words = || {
            format!(
                "no new scan in {} (only names that sort after the last one count)",
                self.path.display()
            )
        };
        (self.heard.elapsed() >= SILENCE).then(words)
    }

    fn go_on(&mut self) -> anyhow::Result<()> {
        self.folder.scans = scan_files(&self.path, None)?.pop().into_iter().collect();
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::folder::in_order;

    const PATIENCE: Duration = Duration::from_millis(5);

    #[test]
    fn the_newest_whole_file_wins_and_the_others_are_counted() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, points: usize| {
            let bytes = vec![0; points * 16];
            fs::write(folder.path().join(name), bytes).unwrap();
        };
        let path = folder.path().to_str().unwrap();
        let mut growing = Growing::open(path, &Layout::default()).unwrap();
        let mut scan = Scan::default();
        assert_eq!(growing.load(&mut scan, PATIENCE).unwrap(), Next::NotYet);
        let mut until = |name: &str, growing: &mut Growing| {
            let (begun, mut missed) = (Instant::now(), 0);
            while scan.name != name {
                assert!(begun.elapsed() < Duration::from_secs(30), "{}", scan.name);
                let next = growing.load(&mut scan, PATIENCE).unwrap();
                missed += scan.missed * u64::from(next == Next::Scan);
            }
            (scan.bytes.len() / 16, missed)
        };
        // Scans from before the start were not missed. The newest one is not complete until it stops growing.
        (1..4).for_each(|number| write(&format!("{number}.bin"), 5));
        assert_eq!(until("3", &mut growing), (5, 0));
        for number in 4..7 {
            write(&format!("{number}.bin"), number);
        }
        growing.next().unwrap();
        write("7.bin", 7);
        assert_eq!(until("7", &mut growing), (7, 2));
        // Names sort by their numbers, and files of another format are not scans of this folder.
        ["stray.pcd", "10.bin"].iter().for_each(|name| write(name, 10));
        let file = fs::File::options().write(true).open(folder.path().join("10.bin"));
        let seven = SystemTime::UNIX_EPOCH + Duration::from_secs(7);
        file.unwrap().set_modified(seven).unwrap();
        // The clock of the disk may differ from the system's clock.
        fs::File::open(path).unwrap().set_modified(SystemTime::UNIX_EPOCH).unwrap();
        assert_eq!(until("10", &mut growing), (10, 0));
        assert!(in_order(Path::new("1.25.bin")) < in_order(Path::new("1.5.bin")));
        assert!(growing.silence().is_none());
        let error = Growing::open(&format!("{path}/1.bin"), &Layout::default());
        let error = error.err().unwrap().to_string();
        assert!(error.contains("expected a folder"));
        fs::remove_dir_all(path).unwrap();
        assert!(growing.load(&mut Scan::default(), PATIENCE).is_err());
    }

    #[test]
    fn a_file_that_grows_is_waited_for_unless_a_newer_one_is_there() {
        let folder = tempfile::tempdir().unwrap();
        let layout = Layout::default();
        let mut growing = Growing::open(folder.path().to_str().unwrap(), &layout).unwrap();
        let put = |name: &str| fs::write(folder.path().join(name), [0; 16]).unwrap();
        put("a.bin");
        assert_eq!(growing.next().unwrap(), None, "it may grow still");
        put("b.bin");
        let (path, missed) = growing.next().unwrap().expect("a newer one is there");
        let name = path.file_name().unwrap().to_str();
        assert_eq!((name, missed), (Some("a.bin"), 0));
    }
}
