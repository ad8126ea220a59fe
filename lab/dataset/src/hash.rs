//! Fingerprints of a data set: a report states the data that it used, a checkpoint the data that it was trained on.

use super::{Dataset, DatasetError, Result};
use mluc_geometry::{FNV_OFFSET, fnv1a};
use rayon::prelude::*;
use std::path::Path;

/// The bytes of every `SCAN_STEP`th scan are hashed.
const SCAN_STEP: usize = 50;

/// FNV-1a (64 bit) of the first `frames` frames, in order: all labels, the sizes of all scans and the bytes of every 50th scan.
pub fn data_hash(dataset: &Dataset, frames: usize) -> Result<String> {
    let names: Vec<&String> = dataset.names().iter().take(frames).collect();
    let one = |(index, name): (usize, &&String)| -> Result<u64> {
        let labels = read(&dataset.label_path(name))?;
        let scan = dataset.scan_path(name);
        let size = std::fs::metadata(&scan).map_err(DatasetError::read(&scan))?;
        let mut hash = fnv1a(fnv1a(FNV_OFFSET, &labels), &size.len().to_le_bytes());
        if index.is_multiple_of(SCAN_STEP) {
            hash = fnv1a(hash, &read(&scan)?);
        }
        Ok(hash)
    };
    let hashes: Vec<u64> = names.par_iter().enumerate().map(one).collect::<Result<_, _>>()?;
    let add = |hash, frame: &u64| fnv1a(hash, &frame.to_le_bytes());
    let whole = hashes.iter().fold(FNV_OFFSET, add);
    Ok(format!("{whole:016x}"))
}

/// FNV-1a (64 bit) over all calibrations, in the order of the frames.
pub fn calibration_hash(dataset: &Dataset) -> Result<String> {
    let mut names = dataset.names().iter();
    let whole = names.try_fold(FNV_OFFSET, |hash, name| {
        Ok(fnv1a(hash, &read(&dataset.calibration_path(name))?))
    })?;
    Ok(format!("{whole:016x}"))
}

fn read(path: &Path) -> Result<Vec<u8>> {
    std::fs::read(path).map_err(DatasetError::read(path))
}
