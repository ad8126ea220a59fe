//! Scans in a folder: their files, order, stamps and poses.

use crate::files::{self, Format, Layout};
use crate::motion::{NO_TIMES, Trajectory};
use crate::{Scan, SourceError, ending, motion::pose as pose_of, refused};
use anyhow::{Context, bail, ensure};
use mluc_ipc_types::{EgoPose, Flags};
use std::{fs, fs::File, io::Read, path::Path, path::PathBuf};

/// Maximum number of bytes read from one scan: 4 million points; the rest could not be used anyway.
const SCAN_BYTES_MAX: u64 = 64 << 20;
/// Number of scans whose sizes are checked before a run.
const SIZES: usize = 5;
/// Number of bytes of the first scan that are checked.
const START_BYTES: u64 = 1 << 20;
/// Maximum number of scans in one run; a guess far above any recording.
const SCANS_MAX: usize = 1_000_000;

/// A folder of scans, or a single scan.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Folder {
    /// Files of the scans, in order.
    pub(crate) scans: Vec<PathBuf>,
    /// The sensor's time of each scan, ns; from `timestamps.txt`.
    stamps_ns: Option<Vec<u64>>,
    /// Where the sensor was at each scan; from `poses.txt`.
    poses: Option<Vec<EgoPose>>,
    /// How the files are read.
    layout: Layout,
}

impl Folder {
    /// Scans without stamps and poses.
    pub(crate) fn of(scans: Vec<PathBuf>, layout: &Layout) -> Folder {
        Folder { scans, layout: layout.clone(), ..Folder::default() }
    }

    /// `input`: one file of a [format](Format), a folder of such files, or a folder with them in `velodyne/` or KITTI raw's `velodyne_points/data/`.
    /// Errors: no scans, scans of several formats, more than a million scans.
    pub(crate) fn find(input: &Path, layout: &Layout) -> anyhow::Result<Folder> {
        let name = input.display();
        let about = fs::metadata(input).with_context(|| format!("input {name}"))?;
        let found = Folder::of(vec![], layout);
        let check = |scans: &[PathBuf]| found.check_columns(scans).context(format!("input {name}"));
        if !about.is_dir() {
            let is_scan = about.is_file() && Format::of(input).is_some();
            ensure!(is_scan, "input {name}: {}", refusal(input));
            let scans = vec![input.to_path_buf()];
            check(&scans)?;
            return Ok(Folder { scans, ..found });
        }
        for inner in PLACES {
            let folder = input.join(inner);
            let scans = scan_files(&folder, None)?;
            if !scans.is_empty() {
                check(&scans)?;
                let poses = match poses(&folder, scans.len()) {
                    Err(error) if !layout.deskew => {
                        tracing::warn!("{error:#}: poses are not used");
                        None
                    }
                    poses => poses?,
                };
                return Ok(Folder {
                    stamps_ns: stamps(&folder, scans.len()),
                    poses,
                    scans,
                    ..found
                });
            }
        }
        let below = "velodyne/ or velodyne_points/data/ below it (of several recordings, .mcap, name one; unpack .mcap.zstd first; of a ROS bag `mcap convert IN OUT.mcap` makes one)";
        let endings = endings();
        bail!("input {name}: no scans ({endings}) there, nor in {below}")
    }

    /// Refuses motion correction if the scans have no stamps and poses, or if the points of the first scan have no times.
    pub(crate) fn check_motion(&self) -> anyhow::Result<()> {
        let is_known = self.stamps_ns.is_some() && self.poses.is_some();
        let expected = "expected valid poses.txt and timestamps.txt beside the scans";
        ensure!(is_known, "{expected}");
        let mut scan = Scan::default();
        self.read(0, &mut scan);
        ensure!(scan.bytes.is_empty() || !scan.times_ns.is_empty(), "{NO_TIMES}");
        Ok(())
    }

    /// Refuses `.bin` files whose number of columns is not four. A single file of another size among several is cut short and is no reason to refuse.
    pub(crate) fn check_columns(&self, scans: &[PathBuf]) -> Result<(), SourceError> {
        let are = |format| scans.iter().all(|path| Format::of(path) == Some(format));
        let is_five = are(Format::NuScenes);
        if !is_five && !are(Format::Bin) {
            return Ok(());
        }
        let size = |path| fs::metadata(path).map_or(0, |about| about.len());
        let sizes: Vec<u64> = scans.iter().take(SIZES).map(size).collect();
        let named = match self.layout.columns.len() as u64 {
            0 if is_five => 5,
            named => named,
        };
        // A pipe has size 0, and bytes read from it cannot be read again.
        let first = scans.first().filter(|_| sizes[0] > 0);
        let mut start = Vec::new();
        if let Some(Ok(file)) = first.map(File::open) {
            // A file that cannot be read is flagged when it is loaded.
            let _ = file.take(START_BYTES).read_to_end(&mut start);
        }
        let is_named = !self.layout.columns.is_empty();
        if is_five && !is_named && files::has_negative_intensities(&start, 5) {
            let found = "negative ones: say which columns with --columns x,y,z,intensity,..";
            return refused("numbers", "20 bytes a point, the fourth an intensity", found);
        }
        if named > 0 {
            let fitting = sizes.iter().filter(|size| size.is_multiple_of(4 * named));
            if 2 * fitting.count() >= sizes.len() {
                return Ok(());
            }
            let expected = format!("{} bytes a point, of {named} columns", 4 * named);
            return refused("size", &expected, format!("{} bytes", sizes[0]));
        }
        files::check_columns(&sizes, &start)
    }

    /// Loads the scan with this number; numbers continue over all rounds.
    pub(crate) fn load(&self, sequence: u64, scan: &mut Scan) {
        let index = (sequence % self.scans.len() as u64) as usize;
        scan.flags = self.read(index, scan);
        self.describe(sequence, scan);
        let (Some(stamps_ns), Some(poses), true) =
            (&self.stamps_ns, &self.poses, self.layout.deskew)
        else {
            return;
        };
        let mut trajectory = Trajectory::default();
        for near in index.saturating_sub(1)..(index + 2).min(poses.len()) {
            let ([x, y, z], yaw) = (poses[near].position_m, poses[near].yaw_rad);
            trajectory.push(stamps_ns[near], pose_of([x, y, z, 0.0, 0.0, yaw]));
        }
        scan.deskew(|after_s| trajectory.at(stamps_ns[index], after_s));
    }

    /// Sets everything of a scan except its points.
    pub(crate) fn describe(&self, sequence: u64, scan: &mut Scan) {
        let index = (sequence % self.scans.len() as u64) as usize;
        scan.name = self.name(index);
        let stamps_ns = self.stamps_ns.as_ref();
        scan.stamp_ns = stamps_ns.map(|stamps| stamps[index]);
        scan.offset_ns = stamps_ns.and_then(|stamps| offset_ns(stamps, sequence));
        scan.pose = self.poses.as_ref().map(|poses| poses[index]);
    }

    /// The frame's name: the file's, without its ending.
    pub(crate) fn name(&self, index: usize) -> String {
        let file = self.scans[index].file_name().unwrap_or_default();
        let file = file.to_string_lossy();
        let lower = file.to_ascii_lowercase();
        let mut endings = Format::ENDINGS.iter().map(|(ending, _)| *ending);
        let ending = endings.find(|ending| lower.ends_with(ending));
        file[..file.len() - ending.map_or(0, str::len)].to_string()
    }

    /// Reads a scan of any format into `scan`, whose memory is reused: x, y, z (m), intensity as f32. The flags report a scan that is longer than allowed,
    /// ends too early, or could not be read.
    fn read(&self, index: usize, scan: &mut Scan) -> Flags {
        self.read_points(index, scan).unwrap_or_else(|error| {
            let path = self.scans[index].display();
            tracing::warn!(%path, "cannot read a scan, an empty frame takes its place: {error:#}");
            scan.bytes.clear();
            Flags::DAMAGED_INPUT
        })
    }

    /// A scan that ends early because the limit cut it is not damaged.
    fn read_points(&self, index: usize, scan: &mut Scan) -> anyhow::Result<Flags> {
        let mut file = std::mem::take(&mut scan.bytes);
        file.clear();
        let path = &self.scans[index];
        let format = Format::of(path).context("a file of another format")?;
        let mut limited = File::open(path)?.take(SCAN_BYTES_MAX + 1);
        let is_long = limited.read_to_end(&mut file)? as u64 > SCAN_BYTES_MAX;
        let is_cut = format.convert(&self.layout, file, scan)?;
        scan.bytes.truncate(SCAN_BYTES_MAX as usize);
        Ok(match (is_cut, is_long) {
            (false, _) => Flags::default(),
            (true, false) => {
                let what = "ends within a point, or has fewer or more points than its header says";
                tracing::warn!("{}: damaged: {what}", path.display());
                Flags::DAMAGED_INPUT
            }
            (true, true) => Flags::TRUNCATED,
        })
    }
}

/// Time of a scan after the first one, ns; `None` if the stamps do not differ.
fn offset_ns(stamps_ns: &[u64], sequence: u64) -> Option<u64> {
    let (count, span) = (stamps_ns.len() as u64, stamps_ns.last()? - stamps_ns[0]);
    // Each further round begins one mean period after the last stamp.
    let round = span + span / (count - 1).max(1);
    let at = stamps_ns[(sequence % count) as usize] - stamps_ns[0];
    (span > 0).then(|| (sequence / count) * round + at)
}

fn endings() -> String {
    Format::ENDINGS.map(|(ending, _)| ending).join(", ")
}

/// Error text: what was expected instead of this file, and a hint.
fn refusal(input: &Path) -> String {
    let help = match ending(input).as_str() {
        "bag" | "db3" => "; `mcap convert IN OUT.mcap` makes an .mcap of it, which is read",
        "laz" => "; `pdal translate IN.laz OUT.las` makes a .las of it, which is read",
        "zstd" | "zst" | "gz" | "xz" | "bz2" => "; unpack it first",
        _ => "",
    };
    let scan = endings();
    format!("expected a scan ({scan}), a capture, a recording (.mcap), or a folder{help}")
}

/// Subfolders in which a folder's scans may be; the last one is the folder itself.
const PLACES: [&str; 3] = ["velodyne", "velodyne_points/data", ""];

/// Whether the folder has a scan, directly or in one of these subfolders.
pub(crate) fn has_scans(folder: &Path) -> bool {
    let scans = |inner| scan_files(&folder.join(inner), None);
    PLACES.into_iter().any(|inner| scans(inner).is_ok_and(|scans| !scans.is_empty()))
}

/// Scan files of one format in order of their names, only those that follow `after`; empty if the folder does not exist.
pub(crate) fn scan_files(folder: &Path, after: Option<&Path>) -> anyhow::Result<Vec<PathBuf>> {
    if !folder.is_dir() {
        return Ok(Vec::new());
    }
    let name = folder.display();
    let entries = fs::read_dir(folder).with_context(|| format!("input {name}"))?;
    // Hidden files are metadata of another system.
    let entries = entries.flatten();
    let entries = entries.filter(|entry| !entry.file_name().as_encoded_bytes().starts_with(b"."));
    let paths = entries.map(|entry| entry.path());
    let wanted = after.map(|last| (Format::of(last), in_order(last)));
    let scans = paths.filter(|path| match (Format::of(path), &wanted) {
        (Some(format), Some((wanted, last))) => Some(format) == *wanted && in_order(path) > *last,
        (format, _) => format.is_some(),
    });
    let mut scans: Vec<PathBuf> = scans.take(SCANS_MAX + 1).collect();
    ensure!(scans.len() <= SCANS_MAX, "input {name}: more than {SCANS_MAX} scans");
    scans.sort_by_cached_key(|scan| in_order(scan));
    let mut formats: Vec<_> = scans.iter().filter_map(|path| Format::of(path)).collect();
    formats.sort();
    formats.dedup();
    let expected = "expected scans of one format";
    ensure!(
        formats.len() <= 1,
        "input {name}: {expected}, found {formats:?}: put them into folders of their own"
    );
    Ok(scans)
}

/// A sort key in which numbers sort by value: 9 before 10, and 1.25 before 1.5.
pub(crate) fn in_order(scan: &Path) -> (String, PathBuf) {
    let name = scan.to_string_lossy();
    let words = name.split_inclusive(|c: char| !c.is_ascii_digit());
    let mut is_fraction = false;
    let words = words.map(|word| {
        let end = word.find(|c: char| !c.is_ascii_digit());
        let (digits, rest) = word.split_at(end.unwrap_or(word.len()));
        let is_whole = !digits.is_empty() && !is_fraction;
        is_fraction = is_whole && rest == ".";
        if is_whole { format!("{digits:0>20}{rest}") } else { word.to_string() }
    });
    (words.collect(), scan.to_path_buf())
}

/// A file of this name in the folder of scans or above it.
fn beside(folder: &Path, name: &str) -> Option<PathBuf> {
    let folder = std::path::absolute(folder).ok()?;
    folder.ancestors().take(2).map(|folder| folder.join(name)).find(|path| path.is_file())
}

/// KITTI raw's `timestamps.txt`: `2011-09-26 13:02:25.964389445`, one line per scan. A file that does not fit is logged and not used.
fn stamps(folder: &Path, scans: usize) -> Option<Vec<u64>> {
    let path = beside(folder, "timestamps.txt")?;
    let warn = |error: &_| tracing::warn!(path = %path.display(), "stamps are not used: {error}");
    let text = fs::read_to_string(&path).inspect_err(warn).ok()?;
    let lines = text.lines().filter(|line| !line.trim().is_empty());
    let stamps: Option<Vec<u64>> = lines.map(stamp_ns).collect();
    let path = path.display();
    match stamps {
        Some(stamps) if stamps.len() == scans && stamps.is_sorted() => return Some(stamps),
        Some(stamps) => {
            tracing::warn!(%path, lines = stamps.len(), scans, "timestamps.txt: expected one line per scan, in ascending order; the stamps are not used");
        }
        None => {
            tracing::warn!(%path, "timestamps.txt: expected lines such as 2011-09-26 13:02:25.964389445; the stamps are not used");
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

/// Reads `poses.txt` in the folder of scans or above it: `x y z yaw` of the sensor in a fixed frame (m, rad), one line per scan. Empty lines and lines
/// that begin with `#` are skipped. `None` if there is no such file. Errors: not one line per scan, a line that is not four finite numbers.
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
    Some(EgoPose::new([x, y, z], yaw_rad, 1))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn find(path: &Path) -> anyhow::Result<Folder> {
        Folder::find(path, &Layout::default())
    }

    #[test]
    fn other_files_and_mixed_folders_are_refused_with_what_helps() {
        let root = folder(&["a.bin", "b.pcd", "c/d.bag", "c/d.mcap.zstd", "e/f.PCD.bin"]);
        for (place, words) in [
            ("", "expected scans of one format, found [Bin, Pcd]"),
            ("c/d.bag", "`mcap convert IN OUT.mcap`"),
            ("c/d.mcap.zstd", "unpack it first"),
            ("c", "no scans (.pcd.bin, .bin,"),
            ("nowhere", "nowhere"),
        ] {
            let error = find(&root.path().join(place)).unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        }
        fs::write(root.path().join("e/f.PCD.bin"), [0; 20]).unwrap();
        assert_eq!(find(&root.path().join("e")).unwrap().name(0), "f");
        let four = [1.5f32, -2.5, -1.5, 0.5].map(f32::to_le_bytes).concat();
        fs::write(root.path().join("e/f.PCD.bin"), four.repeat(200)).unwrap();
        let error = format!("{:#}", find(&root.path().join("e")).expect_err("no rings"));
        assert!(error.contains("negative ones: say which columns"), "{error}");
        let columns = "x,y,z,intensity,ring,time".split(',').map(str::to_string);
        let layout = Layout { columns: columns.collect(), ..Layout::default() };
        let error = Folder::find(&root.path().join("a.bin"), &layout).err();
        let error = format!("{:#}", error.expect("no whole point"));
        assert!(error.contains("expected 24 bytes a point"), "{error}");
    }

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
            let source = find(root.path()).unwrap();
            let names: Vec<String> = (0..source.scans.len()).map(|i| source.name(i)).collect();
            assert_eq!(names, ["000000", "000002"]);
        }
    }

    #[test]
    fn rounds_follow_each_other_at_the_mean_period() {
        let stamps_ns = [50, 60, 90];
        let offsets = [0, 1, 2, 3, 4, 6].map(|n| offset_ns(&stamps_ns, n).unwrap());
        assert_eq!(offsets, [0, 10, 40, 60, 70, 120]);
        assert_eq!(offset_ns(&[7], 3), None);
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
    fn a_scan_beyond_the_limit_is_truncated_and_not_damaged() {
        let header = "FIELDS x y z w\nSIZE 4 4 4 8\nTYPE F F F F\nCOUNT 1 1 1 4096\nPOINTS 3000\nDATA binary\n";
        for ending in [".pcd", ".bin"] {
            let file = tempfile::Builder::new().suffix(ending).tempfile().unwrap();
            fs::write(file.path(), header).unwrap();
            file.as_file().set_len(2 * SCAN_BYTES_MAX).unwrap();
            let source = Folder::of(vec![file.path().into()], &Layout::default());
            assert_eq!(source.read(0, &mut Scan::default()), Flags::TRUNCATED);
        }
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
            let root = folder_with(content);
            fs::write(root.path().join("a.bin"), [0; 16]).unwrap();
            fs::write(root.path().join("b.bin"), [0; 16]).unwrap();
            let mut layout = Layout::default();
            assert_eq!(find(root.path()).unwrap().poses, None);
            layout.deskew = true;
            let error = Folder::find(root.path(), &layout).unwrap_err();
            assert!(format!("{error:#}").contains(words), "{error:#}");
        }
    }
}
