//! The report's folder on the disk.

use std::fmt::Write;
use std::fs;
use std::path::Path;

use anyhow::{Context, bail};
use mluc_report::{Frame, Report, STAGES, Sample, check_version, page, read_frames, write_frames};
use serde_json::Value;

/// Made before anything is measured: a path that cannot be written is said at once.
pub(super) fn make(folder: &Path) -> anyhow::Result<()> {
    fs::create_dir_all(folder)
        .with_context(|| format!("making the report's folder {}", folder.display()))?;
    let probe = folder.join(".probe");
    fs::write(&probe, b"").with_context(|| format!("writing into {}", folder.display()))?;
    fs::remove_file(&probe).with_context(|| format!("writing into {}", folder.display()))
}

/// All files of a report.
pub(super) fn write(
    folder: &Path,
    report: &Report,
    frames: &[Frame],
    samples: &[Sample],
) -> anyhow::Result<()> {
    make(folder)?;
    let json = serde_json::to_string_pretty(report).context("writing report.json")?;
    let files = [
        ("report.json", json),
        ("report.html", page(report, frames, samples)),
        ("frames.csv", write_frames(frames)),
        ("resources.csv", resources(samples)),
    ];
    for (name, text) in files {
        let path = folder.join(name);
        fs::write(&path, text).with_context(|| format!("writing {}", path.display()))?;
    }
    Ok(())
}

fn resources(samples: &[Sample]) -> String {
    let mut text = String::from("at_s");
    for stage in STAGES {
        let _ = write!(text, ",{stage}_cpu_cores,{stage}_memory_mib");
    }
    for sample in samples {
        let _ = write!(text, "\n{:.3}", sample.at_s);
        for (cores, mib) in sample.cpu_cores.iter().zip(&sample.memory_mib) {
            let _ = write!(text, ",{cores:.4},{mib:.1}");
        }
    }
    text + "\n"
}

/// A report that was written by this version of the program.
pub(super) fn read(folder: &Path) -> anyhow::Result<(Value, Vec<Frame>)> {
    let read = |name: &str| {
        let path = folder.join(name);
        fs::read_to_string(&path)
            .with_context(|| format!("{}: no report of `mluc bench`", path.display()))
    };
    let report: Value = serde_json::from_str(&read("report.json")?)
        .with_context(|| format!("{}: no JSON", folder.join("report.json").display()))?;
    check_version(&report).with_context(|| folder.display().to_string())?;
    let frames = read_frames(&read("frames.csv")?).with_context(|| folder.display().to_string())?;
    if frames.is_empty() {
        bail!("{}: frames.csv holds no frame", folder.display());
    }
    Ok((report, frames))
}
