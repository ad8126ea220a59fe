//! The scans that are built into the program, in a temporary folder while they are used.

use anyhow::Context;
use std::{fs, path::Path};
use tempfile::TempDir;

/// A scan of `assets/`: its name, its points (KITTI's `.bin`, packed with zstd) and its labels.
macro_rules! bundled {
    ($name:literal) => {
        (
            $name,
            include_bytes!(concat!("../assets/", $name, ".bin.zst")).as_slice(),
            include_str!(concat!("../assets/", $name, ".txt")),
        )
    };
}

const SCANS: [(&str, &[u8], &str); 4] =
    [bundled!("000010"), bundled!("000080"), bundled!("000209"), bundled!("000380")];

/// The scans as files: `velodyne/NAME.bin` and `label_2/NAME.txt`.
pub struct BundledScans(TempDir);

impl BundledScans {
    /// `purpose`: part of the folder's name.
    pub fn write(purpose: &str) -> anyhow::Result<BundledScans> {
        let folder = TempDir::with_prefix(format!("mluc-{purpose}-"));
        let scans = BundledScans(folder.context("a folder for the bundled scans")?);
        for (name, bytes, labels) in SCANS {
            let points = zstd::decode_all(bytes);
            let points = points.with_context(|| format!("bundled scan {name}"))?;
            scans.file("velodyne", &format!("{name}.bin"), &points)?;
            scans.file("label_2", &format!("{name}.txt"), labels.as_bytes())?;
        }
        Ok(scans)
    }

    fn file(&self, folder: &str, name: &str, bytes: &[u8]) -> anyhow::Result<()> {
        let folder = self.0.path().join(folder);
        let made = fs::create_dir_all(&folder);
        let written = made.and_then(|()| fs::write(folder.join(name), bytes));
        written.with_context(|| format!("writing {name} in {}", folder.display()))
    }

    /// Where the files lie.
    pub fn folder(&self) -> &Path {
        self.0.path()
    }
}
