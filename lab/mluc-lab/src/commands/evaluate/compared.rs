//! The common part of `evaluate ap` and `evaluate operating`: detections, and the labels that they are compared with.

use super::unknown_labelled;
use crate::commands::terminal::print_err;
use anyhow::Result;
use clap::Args;
use mluc_evaluate::input::{Input, Source, read, sources};
use mluc_evaluate::{ClassRule, RuleRequest, UNKNOWN, UnknownProtocol, rules};
use mluc_geometry::ImageSize;
use std::path::PathBuf;

#[derive(Args)]
pub(super) struct Compared {
    /// Folder of label files (label_2). Repeat it to pool folders: --detections and --calib then in the same order.
    #[arg(long, required = true, value_name = "DIR")]
    pub(super) labels: Vec<PathBuf>,
    /// Folder of detection files in KITTI's format, or a file of JSON lines as `mluc up` prints them.
    #[arg(long, required = true, value_name = "DIR|FILE.jsonl")]
    pub(super) detections: Vec<PathBuf>,
    /// Folder of calibration files; JSON lines need it.
    #[arg(long, value_name = "DIR")]
    calib: Vec<PathBuf>,
    /// Known objects below this score are left out, as `mluc up` leaves them out.
    #[arg(long, allow_negative_numbers = true, value_name = "SCORE")]
    min_score: Option<f64>,
    /// Unknown objects below this score are left out.
    #[arg(long, allow_negative_numbers = true, value_name = "SCORE")]
    min_unknown_score: Option<f64>,
    /// Size of the images, of all --labels [default: that of image_2/ next to the labels; without it 1242x375, or as far as the labels
    /// reach]. Detections outside the image are left out; where P2 of a calibration is all 0, there is no image.
    #[arg(long, value_parser = image_size, value_name = "WxH")]
    image_size: Option<ImageSize>,
    /// Detections farther than this in the ground plane are left out, and labels farther than this may be found or not: neither is
    /// right or wrong. The centre of the box counts, from the origin of the labels: KITTI's camera, 0.3 m ahead of the sensor.
    #[arg(long, value_parser = range_m, value_name = "METRES")]
    range_max_m: Option<f64>,
    #[command(flatten)]
    pub(super) request: RuleRequest,
}

impl Compared {
    /// Reads all sources, with these detections; warnings go to stderr.
    pub(super) fn read(
        &self,
        detections: &[PathBuf],
        scans: &[PathBuf],
    ) -> Result<(Vec<Source>, Input)> {
        let sources = sources(&self.labels, detections, &self.calib, scans)?;
        let mut input = read(&sources, self.image_size)?;
        for frame in &mut input.frames {
            frame.detections.retain(|object| {
                let is_unknown = object.is(UNKNOWN);
                let least = [self.min_score, self.min_unknown_score][usize::from(is_unknown)];
                least.is_none_or(|least| object.score.unwrap_or_default() >= least)
            });
            if let Some(range_max_m) = self.range_max_m {
                frame.limit_range(range_max_m);
            }
        }
        for warning in &input.warnings {
            print_err(format_args!("warning: {warning}"));
        }
        Ok((sources, input))
    }

    /// The evaluation rules of the classes.
    pub(super) fn rules(&self, input: &Input, protocol: UnknownProtocol) -> Result<Vec<ClassRule>> {
        let labels = input.frames.iter().flat_map(|frame| frame.labels.iter());
        let request = RuleRequest {
            unknown: unknown_labelled(labels, &self.request.unknown)?,
            protocol,
            ..self.request.clone()
        };
        Ok(rules(&request, &input.frames)?)
    }
}

fn image_size(text: &str) -> Result<ImageSize, String> {
    let side = |text: &str| text.parse().ok().filter(|side| *side > 0);
    let sides =
        text.split_once('x').and_then(|(width, height)| Some((side(width)?, side(height)?)));
    let size = sides.map(|(width_px, height_px)| ImageSize { width_px, height_px });
    size.ok_or_else(|| format!("expected WIDTHxHEIGHT in pixels such as 1242x375, found '{text}'"))
}

fn range_m(text: &str) -> Result<f64, String> {
    let range_m = text.parse().ok().filter(|range_m| *range_m > 0.0);
    range_m.ok_or_else(|| format!("expected metres above 0, found '{text}'"))
}
