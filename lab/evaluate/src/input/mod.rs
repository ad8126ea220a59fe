//! From folders and files to frames.
//!
//! A source is a folder of labels with its detections: a folder of detection files in KITTI's format with the same names, or one file of JSON lines
//! with a folder of calibrations that bring its boxes into the camera frame. Several sources are pooled: the same name in two of them is two frames.

mod json_lines;

use crate::pipeline::finite_points;
use crate::{EvaluateError, FrameRings, FrameTruth, LabelledFrame, Result, SensorDetection};
pub use json_lines::read_json_lines;
use mluc_dataset::{Label, file_stems, read_calibration, read_detections, read_labels, read_scan};
use mluc_geometry::ImageSize;
use mluc_ipc_types::FrameHeader;
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use std::{collections::BTreeMap, collections::BTreeSet, fs::File, io::BufReader};

/// One folder of labels and its detections.
#[derive(Clone, Debug)]
pub struct Source {
    /// Folder of label files. Its frames are evaluated.
    pub labels: PathBuf,
    /// Folder of detection files, or a file of JSON lines.
    pub detections: PathBuf,
    /// Folder of calibration files; required for JSON lines.
    pub calibration: Option<PathBuf>,
    /// Folder of scans; required for [`rings`].
    pub scans: Option<PathBuf>,
}

/// The frames of all sources.
#[derive(Clone, Debug, Default)]
pub struct Input {
    /// Sorted by source, then by name.
    pub frames: Vec<LabelledFrame>,
    /// Number of frames of each source.
    pub counts: Vec<usize>,
    /// Warnings that a reader of the figures needs.
    pub warnings: Vec<String>,
}

/// Pairs the options of a command: as many detections as labels; as many calibrations as labels, or none; as many scan folders as labels, or none.
pub fn sources(
    labels: &[PathBuf],
    detections: &[PathBuf],
    calibrations: &[PathBuf],
    scans: &[PathBuf],
) -> Result<Vec<Source>> {
    let expected = labels.len();
    for (what, found, optional) in [
        ("--detections", detections.len(), false),
        ("--calib", calibrations.len(), true),
        ("--scans", scans.len(), true),
    ] {
        if found != expected && !(optional && found == 0) {
            return Err(EvaluateError::Input(format!(
                "expected as many {what} as --labels ({expected}), in the same order, found {found}"
            )));
        }
    }
    let source = |i: usize| Source {
        labels: labels[i].clone(),
        detections: detections[i].clone(),
        calibration: calibrations.get(i).cloned(),
        scans: scans.get(i).cloned(),
    };
    Ok((0..expected).map(source).collect())
}

/// Detections from JSON lines by frame, with the folder of calibrations.
type Lines<'a> = (&'a Path, BTreeMap<String, Vec<SensorDetection>>);

/// Reads every source. A frame without detections counts as a frame with no object found, with a warning. Detections of frames
/// without labels are left out, with a warning. A source without any detection of a labelled frame is an error. `image` is the size of all
/// images; `None`: the size of each image in `image_2` next to the labels, else the assumed size.
pub fn read(sources: &[Source], image: Option<ImageSize>) -> Result<Input> {
    let mut input = Input::default();
    for source in sources {
        let labelled = file_stems(&source.labels, "txt", "label files (*.txt)")?;
        let lines = lines(source)?;
        let detected = match &lines {
            Some((_, frames)) => frames.keys().cloned().collect(),
            None => file_stems(&source.detections, "txt", "detection files (*.txt)")?,
        };
        let named = labelled.iter().map(|name| match lines {
            Some(_) => FrameHeader::cut(name).to_owned(),
            None => name.clone(),
        });
        let warnings = compare_names(source, &named.collect::<Vec<_>>(), &detected)?;
        input.warnings.extend(warnings);
        input.counts.push(labelled.len());
        let label = |name| Ok(read_labels(&source.labels.join(format!("{name}.txt")))?);
        let labels: Vec<Vec<Label>> = labelled.iter().map(label).collect::<Result<_>>()?;
        let assumed = image_size(&labels);
        for (name, labels) in labelled.iter().zip(labels) {
            let frame = frame(source, lines.as_ref(), (name, labels), image, assumed)?;
            input.frames.push(frame);
        }
    }
    Ok(input)
}

/// The rings on every object of the frames that [`read`] returned for these sources; `None` where a source has no scans.
pub fn rings(sources: &[Source], frames: &[LabelledFrame]) -> Result<Option<Vec<FrameRings>>> {
    let mut files = Vec::new();
    for source in sources {
        let Some(scans) = &source.scans else {
            return Ok(None);
        };
        let Some(calibrations) = &source.calibration else {
            let what = "rings need the calibration of the frames: expected --calib DIR, found none";
            return Err(EvaluateError::file(scans, what));
        };
        for name in file_stems(&source.labels, "txt", "label files (*.txt)")? {
            let scan = scans.join(format!("{name}.bin"));
            files.push((scan, calibrations.join(format!("{name}.txt"))));
        }
    }
    let one = |((scan, calibration), frame): (&(PathBuf, PathBuf), &LabelledFrame)| {
        let points = finite_points(&read_scan(scan)?);
        let calibration = read_calibration(calibration)?;
        Ok(FrameRings::of(frame, &calibration, &points))
    };
    let all: Result<Vec<_>> = files.par_iter().zip(frames).map(one).collect();
    all.map(Some)
}

/// `None` where the detections are a folder of files.
fn lines(source: &Source) -> Result<Option<Lines<'_>>> {
    let path = &source.detections;
    let fault = |what| Err(EvaluateError::file(path, what));
    if path.is_dir() {
        return Ok(None);
    }
    if !path.exists() {
        let what = "expected a folder of detection files or a file of JSON lines, found nothing";
        return fault(what);
    }
    let Some(calibrations) = &source.calibration else {
        return fault(
            "JSON lines need the calibration of their frames: expected --calib DIR, found none",
        );
    };
    Ok(Some((calibrations, read_json_lines(path)?)))
}

fn frame(
    source: &Source,
    lines: Option<&Lines>,
    (name, labels): (&str, Vec<Label>),
    image: Option<ImageSize>,
    assumed: ImageSize,
) -> Result<LabelledFrame> {
    let (file, labels) = (format!("{name}.txt"), labels.into());
    let Some((calibrations, frames)) = lines else {
        let path = source.detections.join(file);
        // The image boxes come from the file; no detection is dropped.
        let detections = path.is_file().then(|| read_detections(&path));
        let detections = detections.transpose()?.unwrap_or_default();
        return Ok(LabelledFrame { labels, detections });
    };
    let truth = FrameTruth {
        labels,
        calibration: read_calibration(&calibrations.join(file))?,
        image: image.map_or_else(|| image_size_beside(&source.labels, name, assumed), Ok)?,
    };
    let found = frames.get(FrameHeader::cut(name));
    Ok(truth.with(found.map_or(&[], Vec::as_slice)))
}

/// Checks that labels and detections share frames; returns warnings about frames that only one of them has.
fn compare_names(source: &Source, labelled: &[String], detected: &[String]) -> Result<Vec<String>> {
    let only = |these: &[String], others: &[String]| -> Vec<String> {
        let others: BTreeSet<&String> = others.iter().collect();
        these.iter().filter(|name| !others.contains(name)).cloned().collect()
    };
    let (missing, foreign) = (only(labelled, detected), only(detected, labelled));
    if missing.len() == labelled.len() {
        let [here, there] = [detected, labelled].map(|names| names.first().map_or("", |n| n));
        let what = format!(
            "expected detections of frames in {}, found none (first here '{here}', first there '{there}')",
            source.labels.display()
        );
        return Err(EvaluateError::file(&source.detections, what));
    }
    let missing_words = "have labels but no detections: counted with nothing found";
    let foreign_words = "have detections but no labels: left out";
    let warning = |names: &[String], what: &str, path: &Path| {
        let (first, path, count) = (names.first()?, path.display(), names.len());
        Some(format!("{path}: {count} frames {what} (first: {first})"))
    };
    let missing = warning(&missing, missing_words, &source.detections);
    let foreign = warning(&foreign, foreign_words, &source.labels);
    Ok([missing, foreign].into_iter().flatten().collect())
}

/// Assumed image size of a folder: KITTI's size, or larger where its labels reach further.
pub(crate) fn image_size<'a>(labels: impl IntoIterator<Item = &'a Vec<Label>>) -> ImageSize {
    let labels = labels.into_iter().flatten();
    labels.fold(ImageSize::KITTI, |size, label| {
        let [_, _, right, bottom] =
            label.image_box_px.map(|px| (px.ceil() as u32).saturating_add(1));
        ImageSize { width_px: size.width_px.max(right), height_px: size.height_px.max(bottom) }
    })
}

/// Size of `image_2/NAME.png` next to the folder of labels where it is present, else the assumed size.
pub(crate) fn image_size_beside(labels: &Path, name: &str, other: ImageSize) -> Result<ImageSize> {
    let path = labels.join("../image_2").join(format!("{name}.png"));
    if !path.is_file() {
        return Ok(other);
    }
    let file = File::open(&path).map_err(|e| EvaluateError::file(&path, e))?;
    let mut decoder = png::Decoder::new(BufReader::new(file));
    let head = decoder.read_header_info().map_err(|e| {
        let what = format!("expected a PNG image of known size, found something else ({e})");
        EvaluateError::file(&path, what)
    })?;
    Ok(ImageSize { width_px: head.width, height_px: head.height })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_size_comes_from_the_image_where_there_is_one() {
        let folder = tempfile::tempdir().expect("a folder");
        let (labels, images) = (folder.path().join("label_2"), folder.path().join("image_2"));
        std::fs::create_dir_all(&labels).expect("a folder");
        std::fs::create_dir_all(&images).expect("a folder");
        let label =
            |right, bottom| Label { image_box_px: [5.0, 5.0, right, bottom], ..Label::default() };
        let all = [vec![label(1400.2, 9.0)], vec![], vec![label(9.0, 300.0)]];
        let assumed = image_size(&all);
        assert_eq!((assumed.width_px, assumed.height_px), (1402, 375));
        let none = image_size_beside(&labels, "0", assumed).expect("no image");
        assert_eq!(none, assumed);
        let file = File::create(images.join("0.png")).expect("a file");
        let mut writer = png::Encoder::new(file, 7, 5);
        writer.set_color(png::ColorType::Grayscale);
        writer.write_header().expect("a header").write_image_data(&[0; 35]).expect("an image");
        let size = image_size_beside(&labels, "0", assumed).expect("an image");
        assert_eq!((size.width_px, size.height_px), (7, 5));
        std::fs::write(images.join("1.png"), [0; 100]).expect("written");
        assert!(image_size_beside(&labels, "1", assumed).is_err());
    }
}
