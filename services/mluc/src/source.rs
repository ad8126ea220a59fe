//! Scans in a folder: which files, in what order, with what stamps and poses.

use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};
use mluc_ipc_types::{EgoPose, Flags};

/// Bytes read of one scan: 4 million points; the rest could not be used anyway.
const SCAN_BYTES_MAX: u64 = 64 << 20;
/// Scans of one run; a guess far above any recording.
const SCANS_MAX: usize = 1_000_000;

/// The scans of a run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Source {
    /// Their files, in order.
    pub scans: Vec<PathBuf>,
    /// The sensor's time of each scan, ns; from `timestamps.txt`.
    pub(crate) stamps_ns: Option<Vec<u64>>,
    /// Where the sensor was at each scan; from `poses.txt`.
    pub(crate) poses: Option<Vec<EgoPose>>,
}

impl Source {
    /// `input`: one `.bin`, or a folder with `.bin` files, or a folder with `velodyne/` or KITTI raw's
    /// `velodyne_points/data/`.
    pub fn find(input: &Path) -> anyhow::Result<Source> {
        let name = input.display();
        let about = fs::metadata(input).with_context(|| format!("input {name}"))?;
        if !about.is_dir() {
            let is_scan = about.is_file() && input.extension().is_some_and(|kind| kind == "bin");
            let expected = "a scan that ends in .bin, or a folder";
            ensure!(is_scan, "input {name}: expected {expected}");
            let scans = vec![input.to_path_buf()];
            return Ok(Source {
                scans,
                ..Source::default()
            });
        }
        for inner in ["velodyne", "velodyne_points/data", ""] {
            let folder = input.join(inner);
            let scans = bin_files(&folder)?;
            if !scans.is_empty() {
                return Ok(Source {
                    stamps_ns: stamps(&folder, scans.len()),
                    poses: poses(&folder, scans.len())?,
                    scans,
                });
            }
        }
        let below = "velodyne/ or velodyne_points/data/ below it";
        bail!("input {name}: no .bin scans there, nor in {below}")
    }

    /// The frame's name: the file's, without its ending.
    pub(crate) fn name(&self, index: usize) -> String {
        let stem = self.scans[index].file_stem().unwrap_or_default();
        stem.to_string_lossy().into_owned()
    }

    /// Reads a scan into `bytes`, which is reused. The flags say that it is longer than a scan can be and was cut, or could
    /// not be read.
    pub(crate) fn read(&self, index: usize, bytes: &mut Vec<u8>) -> Flags {
        bytes.clear();
        let path = &self.scans[index];
        let file = File::open(path);
        match file.and_then(|file| file.take(SCAN_BYTES_MAX + 1).read_to_end(bytes)) {
            Err(error) => {
                tracing::warn!(%error, path = %path.display(), "cannot read a scan: an empty frame takes its place");
                bytes.clear();
                Flags::DAMAGED_INPUT
            }
            Ok(length) if length as u64 > SCAN_BYTES_MAX => {
                bytes.truncate(SCAN_BYTES_MAX as usize);
                Flags::TRUNCATED
            }
            Ok(_) => Flags::default(),
        }
    }
}

/// None where there is no such folder.
fn bin_files(folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    if !folder.is_dir() {
        return Ok(Vec::new());
    }
    let name = folder.display();
    let entries = fs::read_dir(folder).with_context(|| format!("input {name}"))?;
    let paths = entries.flatten().map(|entry| entry.path());
    let scans = paths.filter(|path| path.extension().is_some_and(|kind| kind == "bin"));
    let mut scans: Vec<PathBuf> = scans.take(SCANS_MAX + 1).collect();
    let is_bounded = scans.len() <= SCANS_MAX;
    ensure!(is_bounded, "input {name}: more than {SCANS_MAX} scans");
    scans.sort();
    Ok(scans)
}

/// A file of this name in the folder of scans or above it.
fn beside(folder: &Path, name: &str) -> Option<PathBuf> {
    let mut paths = folder.ancestors().take(2).map(|folder| folder.join(name));
    paths.find(|path| path.is_file())
}

/// KITTI raw's `timestamps.txt`: `2011-09-26 13:02:25.964389445`, a line a scan. A file that does not fit is logged and not
/// used.
fn stamps(folder: &Path, scans: usize) -> Option<Vec<u64>> {
    let path = beside(folder, "timestamps.txt")?;
    let text = fs::read_to_string(&path).ok()?;
    let lines = text.lines().filter(|line| !line.trim().is_empty());
    let stamps: Option<Vec<u64>> = lines.map(stamp_ns).collect();
    let path = path.display();
    match stamps {
        Some(stamps) if stamps.len() == scans && stamps.is_sorted() => return Some(stamps),
        Some(stamps) => {
            tracing::warn!(%path, lines = stamps.len(), scans, "stamps are not one a scan in ascending order: not used");
        }
        None => {
            tracing::warn!(%path, "stamps are not of the form 2011-09-26 13:02:25.964389445: not used");
        }
    }
    None
}

/// Nanoseconds since 1970 of a stamp in UTC.
fn stamp_ns(line: &str) -> Option<u64> {
    let time = humantime::parse_rfc3339_weak(line.trim()).ok()?;
    let since = time.duration_since(std::time::UNIX_EPOCH).ok()?;
    u64::try_from(since.as_nanos()).ok()
}

/// Reads `poses.txt` in the folder of scans or above it: `x y z yaw` of the sensor in a frame that stands still (m, rad),
/// a line a scan; empty lines and those that begin with `#` are left out. None where there is no such file. Errors:
/// another number of lines than scans, a line that is not four finite numbers.
fn poses(folder: &Path, scans: usize) -> anyhow::Result<Option<Vec<EgoPose>>> {
    let Some(path) = beside(folder, "poses.txt") else {
        return Ok(None);
    };
    let name = path.display();
    let text = fs::read_to_string(&path).with_context(|| format!("poses {name}"))?;
    let mut poses = Vec::new();
    let lines = (1..).zip(text.lines().map(str::trim));
    for (number, line) in lines.filter(|(_, line)| !line.is_empty() && !line.starts_with('#')) {
        let expected = "expected four finite numbers `x y z yaw` (m, rad)";
        let fault = || format!("poses {name}, line {number}: {expected}, found `{line}`");
        poses.push(pose(line).with_context(fault)?);
    }
    let found = poses.len();
    let expected = format!("expected one a scan, {scans}");
    ensure!(found == scans, "poses {name}: {expected}, found {found}");
    Ok(Some(poses))
}

fn pose(line: &str) -> Option<EgoPose> {
    let words = line.split_whitespace();
    let numbers = words.map(|word| word.parse().ok().filter(|v: &f64| v.is_finite()));
    let [x, y, z, yaw_rad] = numbers.collect::<Option<Vec<f64>>>()?[..] else {
        return None;
    };
    Some(EgoPose {
        position_m: [x, y, z],
        yaw_rad,
        is_known: 1,
        ..EgoPose::default()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(files: &[&str]) -> tempfile::TempDir {
        let root = tempfile::tempdir().unwrap();
        for file in files {
            let path = root.path().join(file);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, b"x").unwrap();
        }
        root
    }

    #[test]
    fn scans_are_found_in_all_layouts_and_sorted() {
        for inner in ["", "velodyne/", "velodyne_points/data/"] {
            let files = ["000002.bin", "000000.bin", "notes.txt"].map(|f| format!("{inner}{f}"));
            let root = folder(&files.each_ref().map(String::as_str));
            let source = Source::find(root.path()).unwrap();
            let names: Vec<String> = (0..source.scans.len()).map(|i| source.name(i)).collect();
            assert_eq!(names, ["000000", "000002"]);
        }
    }

    #[test]
    fn a_missing_and_an_empty_folder_are_errors() {
        let missing = Source::find(Path::new("/nowhere/at/all")).unwrap_err();
        assert!(format!("{missing:#}").contains("/nowhere/at/all"));
        let root = folder(&["notes.txt"]);
        let empty = Source::find(root.path()).unwrap_err().to_string();
        assert!(empty.contains("no .bin scans"), "{empty}");
    }

    #[test]
    fn stamps_are_seconds_since_1970() {
        for (stamp, ns) in [
            ("1970-01-01 00:00:00.000000000", 0),
            ("2011-09-26 13:02:25.964389445", 1_317_042_145_964_389_445),
            ("2024-02-29T12:00:00.5", 1_709_208_000_500_000_000),
        ] {
            assert_eq!(stamp_ns(stamp), Some(ns));
        }
        let bad_days = ["", "2011-09-26", "2011-13-26 13:02:25.9"];
        let bad_hours = ["2011-09-26 25:02:25.9", "a-b-c d:e:f.g"];
        for bad in bad_days.into_iter().chain(bad_hours) {
            assert_eq!(stamp_ns(bad), None, "{bad}");
        }
    }

    #[test]
    fn a_scan_that_cannot_be_read_is_no_end() {
        let source = Source {
            scans: vec!["/nowhere/000007.bin".into()],
            ..Source::default()
        };
        let mut bytes = vec![1, 2, 3];
        assert_eq!(source.read(0, &mut bytes), Flags::DAMAGED_INPUT);
        assert!(bytes.is_empty());
        assert_eq!(source.name(0), "000007");
    }

    fn folder_with(text: &str) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("poses.txt"), text).unwrap();
        folder
    }

    #[test]
    fn a_line_a_scan_is_read_also_from_the_folder_above() {
        let folder = folder_with("# x y z yaw\n1 2 0 0.5\n\n2.5 2 0 -0.5\n");
        let inner = folder.path().join("velodyne");
        let found = poses(&inner, 2).unwrap().unwrap();
        assert_eq!(found[1].position_m, [2.5, 2.0, 0.0]);
        assert_eq!((found[0].yaw_rad, found[0].is_known), (0.5, 1));
        let none = tempfile::tempdir().unwrap();
        assert!(poses(&none.path().join("a"), 2).unwrap().is_none());
    }

    #[test]
    fn what_is_wrong_is_named() {
        for (content, words) in [
            ("1 2 3 4\n", "expected one a scan, 2, found 1"),
            ("1 2 3 4\n1 2 x 4\n", "line 2"),
            ("1 2 3 4\n1 2 3\n", "found `1 2 3`"),
            ("NaN 2 3 4\n1 2 3 4\n", "line 1"),
        ] {
            let error = poses(folder_with(content).path(), 2).unwrap_err();
            assert!(format!("{error:#}").contains(words), "{error:#}");
        }
    }
}
