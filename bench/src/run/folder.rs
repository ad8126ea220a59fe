//! The report's folder on the disk.

use crate::report::{FrameRecord, check_version, page, read_frames, write_frames};
use anyhow::{Context, Result, ensure};
use serde_json::Value;
use std::{fs, path::Path};

/// Folder names of the two reports of a comparison.
pub(crate) const FOLDERS: [&str; 2] = ["a", "b"];

/// Writes a file into a folder of results; creates the folder if it is missing.
pub(crate) fn save(folder: &Path, name: &str, bytes: impl AsRef<[u8]>) -> Result<()> {
    let path = folder.join(name);
    let made = fs::create_dir_all(folder);
    let written = made.and_then(|()| fs::write(&path, bytes));
    written.with_context(|| format!("writing {}", path.display()))
}

/// Creates a folder before anything is measured: a path that cannot be written is reported at once.
pub(crate) fn make(folder: &Path) -> Result<()> {
    save(folder, ".probe", "")?;
    let probe = folder.join(".probe");
    fs::remove_file(&probe).with_context(|| format!("writing into {}", folder.display()))
}

pub(crate) fn write(folder: &Path, report: &Value, frames: &[FrameRecord]) -> Result<()> {
    save(folder, "report.json", serde_json::to_string_pretty(report)?)?;
    save(folder, "report.html", page(report, frames)?)?;
    save(folder, "frames.csv", write_frames(frames))
}

/// Reads a report and its frames. Errors: a file is missing or not valid, or another version of the program wrote it.
pub(crate) fn read(folder: &Path) -> Result<(Value, Vec<FrameRecord>)> {
    let place = || folder.display().to_string();
    let read = |name: &str| {
        let path = folder.join(name);
        let text = fs::read_to_string(&path);
        text.with_context(|| format!("{}: no report of `mluc bench`", path.display()))
    };
    let report: Value = serde_json::from_str(&read("report.json")?)
        .with_context(|| format!("{}/report.json: no JSON", place()))?;
    check_version(&report).with_context(place)?;
    let frames = read_frames(&read("frames.csv")?).with_context(place)?;
    ensure!(!frames.is_empty(), "{}: frames.csv holds no frame", place());
    Ok((report, frames))
}
