//! What is looked at before hours are spent on it: files, classes, boxes, points; and what a checkpoint must have been made of.

use rayon::prelude::*;

use super::error::TrainError;
use super::run::Event;
use super::settings::Settings;
use super::source::{FolderSource, Source};
use crate::dataset::{Dataset, calibration_hash, check_classes, check_files, data_hash};

/// Scans whose labelled boxes are looked into: scans of other frames, or empty ones, show in the first few.
const POINT_FRAMES: usize = 20;

/// The training split: every frame has its files, whole scans, labels of classes that are heard of, a calibration that can be used.
pub(super) fn training_split(settings: &Settings) -> Result<Dataset, TrainError> {
    let dataset = Dataset::open(&settings.data.join("train"))?;
    check(&dataset, settings)?;
    Ok(dataset)
}

/// The same of the validation split, where it is there and wanted.
pub(super) fn validation_split(
    settings: &Settings,
    tell: &mut dyn FnMut(Event),
) -> Result<(), TrainError> {
    let folder = settings.data.join("val");
    if settings.validate_frames == 0 {
        return Ok(());
    }
    if folder.is_dir() {
        return check(&Dataset::open(&folder)?, settings);
    }
    tell(Event::Note(format!(
        "{}: no such folder, so the model is not judged while it trains",
        folder.display()
    )));
    Ok(())
}

fn check(dataset: &Dataset, settings: &Settings) -> Result<(), TrainError> {
    let heard = settings.heard_classes();
    check_files(dataset)?;
    dataset.names().par_iter().try_for_each(|name| {
        check_classes(&dataset.label_path(name), &heard)?;
        dataset.boxes_in_sensor(name).map(drop)
    })?;
    Ok(())
}

/// Labelled boxes without a single point between them are of other scans, or the scans are empty.
pub(super) fn points(source: &FolderSource, settings: &Settings) -> Result<(), TrainError> {
    let frames = source.count().min(POINT_FRAMES);
    let scenes = (0..frames).into_par_iter().map(|i| source.scene(i));
    let scenes: Vec<_> = scenes.collect::<Result<_, _>>()?;
    let objects = || scenes.iter().flat_map(|scene| &scene.objects);
    if objects().count() > 0 && objects().all(|object| object.points == 0) {
        let path = settings.data.join("train");
        return Err(TrainError::NoPoints { path, frames });
    }
    Ok(())
}

/// Settings and data as one text, which a checkpoint must share with the run that goes on from it.
pub(super) fn origin(settings: &Settings, dataset: &Dataset) -> Result<String, TrainError> {
    Ok(format!(
        "{} data {} frames {} calib {}",
        settings.fingerprint(),
        dataset.len(),
        data_hash(dataset, usize::MAX)?,
        calibration_hash(dataset)?
    ))
}
