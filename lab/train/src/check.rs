//! Checks before a long run: files, classes, boxes, points; and the origin that a checkpoint must have.

use crate::{
    error::{TrainError, refused},
    log::TrainEvent,
    settings::TrainSettings,
    source::ScanSource,
    source::stands_for_unknown,
};
use mluc_dataset::{Dataset, calibration_hash, check_classes, check_files, data_hash};
use mluc_model::CLASSES_MAX;
use rayon::prelude::*;

/// Number of scans whose labelled boxes are checked: scans of other frames, or empty scans, show in the first few.
const POINT_FRAMES: usize = 20;

/// Rejects a number of `--known` classes that no model supports; with 0, the classes of the setting apply.
pub fn check_known(known: &[String]) -> Result<(), TrainError> {
    let expected = format!("2 to {CLASSES_MAX} classes");
    match known.len() {
        0 | 2..=CLASSES_MAX => Ok(()),
        found => Err(refused("--known".as_ref(), expected, found)),
    }
}

/// Checks the training split: every frame has its files, a whole scan, labels of accepted classes only, a valid calibration.
pub(crate) fn training_split(settings: &TrainSettings) -> Result<Dataset, TrainError> {
    let dataset = Dataset::open(&settings.data.join("train"))?;
    check(&dataset, settings)?;
    Ok(dataset)
}

/// The same checks for the validation split, where it exists and is used.
pub(crate) fn validation_split(
    settings: &TrainSettings,
    notify: &mut dyn FnMut(TrainEvent),
) -> Result<(), TrainError> {
    let folder = settings.data.join("val");
    if settings.validate_frames == 0 {
        return Ok(());
    }
    if folder.is_dir() {
        return check(&Dataset::open(&folder)?, settings);
    }
    let folder = folder.display();
    let text = format!("{folder}: no such folder, so the model is not judged while it trains");
    notify(TrainEvent::Note(text));
    Ok(())
}

fn check(dataset: &Dataset, settings: &TrainSettings) -> Result<(), TrainError> {
    let heard = settings.accepted_classes();
    check_files(dataset)?;
    dataset.names().par_iter().try_for_each(|name| {
        check_classes(&dataset.label_path(name), &heard)?;
        dataset.boxes_in_sensor(name).map(drop)
    })?;
    Ok(())
}

/// Rejects labels without a single point in any box: they belong to other scans, or the scans are empty.
pub(crate) fn points(source: &ScanSource, settings: &TrainSettings) -> Result<(), TrainError> {
    let frames = source.count().min(POINT_FRAMES);
    let scans = (0..frames).into_par_iter().map(|i| source.scan(i));
    let scans: Vec<_> = scans.collect::<Result<_, _>>()?;
    let mut counts = scans.iter().flat_map(|s| &s.objects).map(|o| o.points);
    if counts.clone().next().is_some() && counts.all(|points| points == 0) {
        let path = settings.data.join("train");
        let expected = "points in the labelled boxes";
        let found =
            format!("none in its first {frames} frames: empty scans, or labels of other ones?");
        return Err(refused(&path, expected, found));
    }
    Ok(())
}

/// Rejects scans without an example of the unknown for a network that learns from such: it would learn that nothing is unknown.
pub(crate) fn examples(source: &ScanSource, settings: &TrainSettings) -> Result<(), TrainError> {
    let is_needed = source.takes_synthetic_unknown && settings.synthetic_unknown() == 0;
    let names = source.dataset.names().iter();
    let mut labels = names.flat_map(|name| source.dataset.labels(name)).flatten();
    if !is_needed || labels.any(|label| stands_for_unknown(&label, &source.classes)) {
        return Ok(());
    }
    let expected = "labels Synthetic_unknown (mix in scans of simulate --synthetic-unknown)";
    let found = "none, and nothing would be unknown (or take --network metric)";
    Err(refused(&settings.data.join("train"), expected, found))
}

/// Settings and data as one text; a resumed run must have the same text as its checkpoint.
pub(crate) fn origin(settings: &TrainSettings, dataset: &Dataset) -> Result<String, TrainError> {
    Ok(format!(
        "{} data {} frames {} calib {}",
        settings.fingerprint(),
        dataset.names().len(),
        data_hash(dataset, usize::MAX)?,
        calibration_hash(dataset)?
    ))
}
