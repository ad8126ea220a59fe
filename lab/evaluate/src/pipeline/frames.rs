//! The labelled frames on which a model is evaluated.

use crate::rings::finite_points;
use crate::{EvaluateError, FrameTruth, Result, input::image_size, input::image_size_beside};
use mluc_dataset::{Dataset, DatasetError};
use mluc_geometry::ImageSize;
use mluc_head::Detection;
use mluc_ipc_types::Point;
use std::path::Path;

/// Frames of a data set; all of them have labels.
#[derive(Clone, Debug)]
pub struct FrameSet {
    dataset: Dataset,
    names: Vec<String>,
    split: String,
    /// Image size where there are no images.
    image: ImageSize,
}

/// The labels of a frame and the boxes that the network kept.
#[derive(Clone, Debug)]
pub struct DetectedFrame {
    /// The labels.
    pub truth: FrameTruth,
    /// Kept boxes in the head's order: boxes with a class, then boxes without one, each by falling objectness.
    pub detections: Vec<Detection>,
}

impl DetectedFrame {
    /// Removes the boxes of anchors that have no class.
    pub fn drop_generic(&mut self) {
        self.detections.retain(Detection::has_class);
    }
}

impl FrameSet {
    /// The first `frames_max` frames of `root`: of the split in `root/ImageSets/SPLIT.txt`, or of all scans.
    /// A frame without a label file is an error, before anything is computed.
    pub fn open(root: &Path, split: Option<&str>, frames_max: usize) -> Result<FrameSet> {
        let dataset = Dataset::open_split(root, split)?;
        let names: Vec<String> = dataset.names().iter().take(frames_max).cloned().collect();
        for name in &names {
            let path = dataset.label_path(name);
            if !path.is_file() {
                let what = format!("frame {name}: expected labels, found no such file");
                return Err(EvaluateError::file(&path, what));
            }
        }
        let labels: Result<Vec<_>, _> = names.iter().map(|name| dataset.labels(name)).collect();
        Ok(FrameSet {
            image: image_size(&labels?),
            split: split.unwrap_or("all").to_owned(),
            dataset,
            names,
        })
    }

    /// Every `count`th frame from `index` on.
    pub fn shard(&self, [index, count]: [u32; 2]) -> FrameSet {
        let names = self.names.iter().skip(index as usize);
        FrameSet { names: names.step_by(count as usize).cloned().collect(), ..self.clone() }
    }

    /// Names of the frames, in order.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Text for a person: folder, split and number of frames.
    pub fn describe(&self) -> String {
        let folder = self.dataset.root();
        let folder = folder.canonicalize().unwrap_or(folder.to_owned());
        // With the parent folder, data sets whose splits have the same folder names can be distinguished.
        let tail = folder_tail(&folder);
        format!("{tail}, split {}, {} frames", self.split, self.names.len())
    }

    /// The frame's scan as the first stage outputs it.
    pub fn points(&self, index: usize) -> Result<Vec<Point>> {
        Ok(scan_points(&self.dataset, &self.names[index])?)
    }

    /// The frame's labels and calibration.
    pub fn truth(&self, index: usize) -> Result<FrameTruth> {
        let name = &self.names[index];
        let labels = self.dataset.root().join("label_2");
        Ok(FrameTruth {
            labels: self.dataset.labels(name)?.into(),
            calibration: self.dataset.calibration(name)?,
            image: image_size_beside(&labels, name, self.image)?,
        })
    }
}

/// The last two parts of a path: they distinguish folders without their full location.
pub fn folder_tail(folder: &Path) -> String {
    let parts = folder.iter().map(|part| part.to_string_lossy());
    let parts: Vec<_> = parts.filter(|part| *part != "/").collect();
    parts[parts.len().saturating_sub(2)..].join("/")
}

/// A scan as the first stage outputs it ([`mluc_ingest::decode_bin`]): finite points, at most the contract's maximum, in file order.
pub fn scan_points(dataset: &Dataset, name: &str) -> Result<Vec<Point>, DatasetError> {
    Ok(finite_points(&dataset.scan(name)?))
}
