//! Things that not every machine has: external reference data, real scans, refiners in other languages (`.ci/examples` installs their needs).

use crate::inputs::root;
use mluc_backbone::{Backbone, BackboneError};
use mluc_dataset::{DatasetError, file_stems, read_scan};
use mluc_model::{Grid, Manifest, Network, VOXELS_MAX};
use std::{io::Write, io::stderr, path::PathBuf, process::Command};

/// Reports in one line that a check did not run. `.ci/run` counts these lines.
pub fn skip(what: &str, why: &str) {
    // Cargo captures the print macros, but not direct writes to the stream. A single call keeps lines of other tests from coming between.
    let _ = stderr().write_all(format!("skipped: {what}: {why}\n").as_bytes());
}

/// The folder that `variable` names. `None`, with a message: the variable is not set. A missing folder is a failure. With
/// `MLUC_REQUIRE_ORACLE=1` an unset MLUC_ORACLE or MLUC_KITTI is a failure, too.
pub fn data_folder(variable: &str) -> Option<PathBuf> {
    let Some(folder) = std::env::var_os(variable).map(PathBuf::from) else {
        let is_one = std::env::var_os("MLUC_REQUIRE_ORACLE").is_some_and(|value| value == "1");
        let is_required = is_one && ["MLUC_ORACLE", "MLUC_KITTI"].contains(&variable);
        let why = format!("{variable} is not set");
        assert!(!is_required, "{why}, and MLUC_REQUIRE_ORACLE=1 asks for it");
        skip(std::thread::current().name().unwrap_or("a test"), &why);
        return None;
    };
    let found = folder.display();
    assert!(folder.is_dir(), "{variable}: expected a folder, found {found}");
    Some(folder)
}

/// The folder of external reference data; see [`data_folder`].
pub fn oracle() -> Option<PathBuf> {
    data_folder("MLUC_ORACLE")
}

/// The Python that has these packages; `None`, with a message: there is none.
pub fn python_with(packages: &str) -> Option<PathBuf> {
    let python = root().join("target/examples/venv/bin/python");
    let mut import = Command::new(&python);
    let output = import.args(["-c", &format!("import {packages}")]).output();
    if output.is_ok_and(|output| output.status.success()) {
        return Some(python);
    }
    let why = format!("no Python with {packages} in target/examples/venv (run .ci/examples)");
    skip("a check in Python", &why);
    None
}

/// The command of a Python script that uses the module mluc; `None`, with a message: Python or its packages are missing.
pub fn python_script(path: &str) -> Option<Vec<String>> {
    let python = python_with("iceoryx2, numpy, mcap_ros2, websockets")?;
    let words = [python, root().join(path)].map(|path| path.display().to_string());
    Some(words.to_vec())
}

/// The command of a Python example, for example of the refiner.
pub fn python_example(kind: &str) -> Option<Vec<String>> {
    python_script(&format!("examples/{kind}-python/{kind}.py"))
}

/// The command of a C++ example; `None`, with a message: it was not built.
pub fn cpp_example(kind: &str) -> Option<Vec<String>> {
    let program = root().join(format!("target/examples/{kind}-cpp/{kind}"));
    if !program.exists() {
        let why = format!("{} is not built (run .ci/examples)", program.display());
        skip(&format!("the C++ {kind}"), &why);
        return None;
    }
    Some(vec![program.display().to_string()])
}

/// A scan, and where its reference data are.
pub struct PaperFrame {
    /// Name of the files, without extension.
    pub name: String,
    pub points: Vec<[f32; 4]>,
    /// Results of the other implementation, by level.
    pub answers: PathBuf,
}

/// All frames that the oracle has, by name, at least one. Without an oracle there are none, which a message reports.
pub fn paper_frames() -> Result<Vec<PaperFrame>, DatasetError> {
    let Some(folder) = oracle().map(|folder| folder.join("second_forward")) else {
        return Ok(vec![]);
    };
    let names = file_stems(&folder, "json", "the answers to `second_forward`")?;
    let frame = |name: String| {
        let file = |extension: &str| folder.join(format!("{name}.{extension}"));
        let (points, answers) = (read_scan(&file("bin"))?, file("json"));
        Ok(PaperFrame { name, points, answers })
    };
    names.into_iter().map(frame).collect()
}

/// The paper's network; its only limit on voxels is the contract's limit on points.
pub fn paper_network() -> Manifest {
    let grid = Grid { voxels_max: VOXELS_MAX, ..Grid::kitti_second() };
    Manifest::untrained("oracle", Network::second(grid, 3))
}

/// The feature map of the last frame: its rows replace the rows of the empty scene.
pub fn feature_map(backbone: &Backbone, mut empty: Vec<f32>) -> Result<Vec<f32>, BackboneError> {
    let channels = backbone.feature_channels();
    let (cells, rows) = backbone.last_rows()?;
    for (cell, row) in cells.iter().zip(rows.chunks_exact(channels)) {
        empty[*cell as usize * channels..][..channels].copy_from_slice(row);
    }
    Ok(empty)
}

pub fn rms(values: impl ExactSizeIterator<Item = f32>) -> f64 {
    let count = values.len() as f64;
    let squares: f64 = values.map(|value| f64::from(value).powi(2)).sum();
    (squares / count).sqrt()
}
