//! What `evaluate ap` and `evaluate operating` share: detections, and the labels that they are held against.

use super::unknown_labelled;
use crate::commands::terminal::print_err;
use clap::Args;
use mluc_evaluate::input::{Input, Source, read, sources};
use mluc_evaluate::{ClassRule, NeighbourPolicy, RuleRequest, UnknownProtocol, rules};
use mluc_geometry::ImageSize;
use std::path::PathBuf;

#[derive(Args)]
pub(super) struct Compared {
    /// Folder of label files (label_2). Repeat it to pool folders: --detections and --calib then in the same order.
    #[arg(long, required = true, value_name = "DIR")]
    labels: Vec<PathBuf>,
    /// Folder of detection files in KITTI's format, or a file of JSON lines as `mluc up` prints them.
    #[arg(long, required = true, value_name = "DIR|FILE.jsonl")]
    detections: Vec<PathBuf>,
    /// Folder of calibration files; JSON lines need it.
    #[arg(long, value_name = "DIR")]
    calib: Vec<PathBuf>,
    /// Overlap a class: a match needs more than it.
    #[arg(long, value_delimiter = ',', value_parser = class_overlap, value_name = "CLASS=IOU,..")]
    iou: Vec<(String, f64)>,
    /// The known classes, exactly.
    #[arg(long, value_delimiter = ',', value_name = "CLASS,..")]
    classes: Vec<String>,
    /// Label classes that are unknown; they are merged into one class, `unknown`. unseen: those of `simulate --unseen`.
    #[arg(long, value_delimiter = ',', value_name = "CLASS,..")]
    pub(super) unknown: Vec<String>,
    /// Overlap of the unknown class.
    #[arg(long, default_value_t = 0.1, value_name = "IOU")]
    unknown_iou: f64,
    /// What look-alikes are (a van found as a car): official, neither right nor wrong; strict, wrong.
    #[arg(long, value_enum, default_value_t)]
    neighbours: NeighbourPolicy,
    /// Size of the images [default: of image_2/ beside the labels where present, else 1242x375]. Where a calibration's
    /// P2 is all 0 there is no image, and nothing is dropped for lying outside it.
    #[arg(long, value_parser = image_size, value_name = "WxH")]
    image_size: Option<ImageSize>,
}

impl Compared {
    /// Reads everything; warnings go to stderr.
    pub(super) fn read(&self, scans: &[PathBuf]) -> anyhow::Result<(Vec<Source>, Input)> {
        let sources = sources(&self.labels, &self.detections, &self.calib, scans)?;
        let input = read(&sources, self.image_size)?;
        for warning in &input.warnings {
            print_err(format_args!("warning: {warning}"));
        }
        Ok((sources, input))
    }

    /// How the classes are judged.
    pub(super) fn rules(
        &self,
        input: &Input,
        protocol: UnknownProtocol,
    ) -> anyhow::Result<Vec<ClassRule>> {
        let labels = input.frames.iter().flat_map(|frame| frame.labels.iter());
        let request = RuleRequest {
            classes: self.classes.clone(),
            iou_min: self.iou.clone(),
            unknown: unknown_labelled(labels, &self.unknown)?,
            unknown_iou_min: self.unknown_iou,
            protocol,
            neighbours: self.neighbours,
        };
        Ok(rules(&request, &input.frames)?)
    }
}

fn class_overlap(text: &str) -> Result<(String, f64), String> {
    let pair = text
        .split_once('=')
        .filter(|(class, _)| !class.trim().is_empty());
    pair.and_then(|(class, iou)| Some((class.trim().to_owned(), iou.trim().parse().ok()?)))
        .ok_or_else(|| format!("expected CLASS=IOU such as car=0.5, found '{text}'"))
}

fn image_size(text: &str) -> Result<ImageSize, String> {
    let side = |text: &str| text.parse().ok().filter(|side| *side > 0);
    let size = text.split_once(['x', 'X']).and_then(|(width, height)| {
        let (width_px, height_px) = (side(width)?, side(height)?);
        Some(ImageSize {
            width_px,
            height_px,
        })
    });
    size.ok_or_else(|| format!("expected WIDTHxHEIGHT in pixels such as 1242x375, found '{text}'"))
}
