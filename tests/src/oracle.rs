//! The paper's network with weights by formula, and the frames to which the oracle has its answers.

use std::path::PathBuf;

use mluc_backbone::{Backbone, BackboneError};
use mluc_dataset::{DatasetError, file_stems, read_scan};
use mluc_model::{Grid, Manifest, Network, VOXELS_MAX};

use crate::skip::oracle;

/// A scan, and where its answers are.
pub struct PaperFrame {
    /// Of the files, without extension.
    pub name: String,
    /// x, y, z, intensity.
    pub points: Vec<[f32; 4]>,
    /// What the other implementation found, by level.
    pub answers: PathBuf,
}

/// Every frame that the oracle has, by name: at least one. None, said, where the oracle is not asked for.
pub fn paper_frames() -> Result<Vec<PaperFrame>, DatasetError> {
    let Some(folder) = oracle().map(|folder| folder.join("second_forward")) else {
        return Ok(vec![]);
    };
    let names = file_stems(&folder, "json", "the answers to `second_forward`")?;
    let frame = |name: String| {
        let file = |extension: &str| folder.join(format!("{name}.{extension}"));
        let (points, answers) = (read_scan(&file("bin"))?, file("json"));
        Ok(PaperFrame {
            name,
            points,
            answers,
        })
    };
    names.into_iter().map(frame).collect()
}

/// The paper's network without a voxel budget but the contract's points.
pub fn paper_network() -> Manifest {
    let grid = Grid {
        voxels_max: VOXELS_MAX,
        ..Grid::kitti_second()
    };
    Manifest::untrained("oracle", Network::second(grid, 3))
}

/// The feature map of the last frame: its rows laid over those of the empty scene.
pub fn feature_map(backbone: &Backbone, mut empty: Vec<f32>) -> Result<Vec<f32>, BackboneError> {
    let channels = backbone.feature_channels();
    let (cells, rows) = backbone.last_rows()?;
    for (cell, row) in cells.iter().zip(rows.chunks_exact(channels)) {
        empty[*cell as usize * channels..][..channels].copy_from_slice(row);
    }
    Ok(empty)
}

/// Root mean square.
pub fn rms(values: impl ExactSizeIterator<Item = f32>) -> f64 {
    let count = values.len() as f64;
    let squares: f64 = values.map(|value| f64::from(value).powi(2)).sum();
    (squares / count).sqrt()
}
