//! `mluc-lab evaluate ap`: detections of any program against labels.

use super::{check_unknown, warn_unrecognized};
use crate::commands::terminal::{print_err, print_out};
use clap::Args;
use mluc_evaluate::input::{read, rings, sources};
use mluc_evaluate::{
    Breakdown, NeighbourPolicy, RuleRequest, UnknownProtocol, evaluate, rules, unevaluated,
};
use mluc_geometry::ImageSize;
use std::path::PathBuf;

/// Average precision as KITTI's object devkit computes it, and open-set figures.
///
/// Prints a table, or JSON with --json. Every labelled frame counts: one without detections counts with nothing found,
/// and a warning on stderr says how many there are. Detections of frames without labels are left out, with a warning.
///
/// Known classes are car, pedestrian and cyclist, those named in --iou, and any labelled class that a detection of kind
/// known names (not Van, Tram, Misc, Person_sitting); --classes names them exactly. Their overlaps are KITTI's (car
/// 0.7, pedestrian and cyclist 0.5), 0.7 for trucks and vans, 0.5 for others, unless --iou says otherwise.
///
/// The open-set figures are of volumes (3d) at moderate; map_known is the mean over the known classes that have labels. Two rows say
/// what unknown labels were found as, and on labels of which class the best unknown detections lie, as many as there are such labels.
#[derive(Args)]
pub(super) struct ApArguments {
    /// Folder of label files (label_2). Repeat it to pool folders: --detections and --calib then in the same order.
    #[arg(long, required = true, value_name = "DIR")]
    labels: Vec<PathBuf>,
    /// Folder of detection files in KITTI's format, or a file of JSON lines as `mluc up` prints them.
    #[arg(long, required = true, value_name = "DIR|FILE.jsonl")]
    detections: Vec<PathBuf>,
    /// Folder of calibration files; JSON lines need it.
    #[arg(long, value_name = "DIR")]
    calib: Vec<PathBuf>,
    /// Folder of scans (velodyne), for AP by the rings on the object; needs --calib.
    #[arg(long, value_name = "DIR")]
    scans: Vec<PathBuf>,
    /// Overlap a class: a match needs more than it.
    #[arg(long, value_delimiter = ',', value_parser = class_overlap, value_name = "CLASS=IOU,..")]
    iou: Vec<(String, f64)>,
    /// The known classes, exactly.
    #[arg(long, value_delimiter = ',', value_name = "CLASS,..")]
    classes: Vec<String>,
    /// Label classes that are unknown; they are merged into one class, `unknown`.
    #[arg(long, value_delimiter = ',', value_name = "CLASS,..")]
    unknown: Vec<String>,
    /// Overlap of the unknown class.
    #[arg(long, default_value_t = 0.1, value_name = "IOU")]
    unknown_iou: f64,
    /// What an unknown object may be found on besides labels of unknown classes: literal, nothing; fair, trams, Misc, sitting
    /// persons, and regions without labels (DontCare), none of which is right or wrong.
    #[arg(long, value_enum, default_value_t)]
    unknown_protocol: UnknownProtocol,
    /// What look-alikes are (a van found as a car): official, neither right nor wrong; strict, wrong.
    #[arg(long, value_enum, default_value_t)]
    neighbours: NeighbourPolicy,
    /// Size of the images [default: of image_2/ beside the labels where present, else 1242x375]. Where a calibration's
    /// P2 is all 0 there is no image, and nothing is dropped for lying outside it.
    #[arg(long, value_parser = image_size, value_name = "WxH")]
    image_size: Option<ImageSize>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
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

pub(super) fn run(arguments: ApArguments) -> anyhow::Result<()> {
    let ApArguments {
        labels,
        detections,
        calib,
        scans,
        ..
    } = &arguments;
    let sources = sources(labels, detections, calib, scans)?;
    let input = read(&sources, arguments.image_size)?;
    for warning in &input.warnings {
        print_err(format_args!("warning: {warning}"));
    }
    let labels = || input.frames.iter().flat_map(|frame| frame.labels.iter());
    check_unknown(labels(), &arguments.unknown)?;
    let asks_unknown = !arguments.unknown.is_empty();
    let request = RuleRequest {
        classes: arguments.classes,
        iou_min: arguments.iou,
        unknown: arguments.unknown,
        unknown_iou_min: arguments.unknown_iou,
        protocol: arguments.unknown_protocol,
        neighbours: arguments.neighbours,
    };
    let rules = rules(&request, &input.frames)?;
    if asks_unknown {
        for class in unevaluated(&input.frames, &rules) {
            print_err(format_args!(
                "warning: labels of class {class} count as background; if it is known, name it in --iou"
            ));
        }
    } else {
        warn_unrecognized(labels(), &rules);
    }
    let report = evaluate(&input.frames, &rules);
    let classes = report.classes.iter();
    for class in classes.filter(|class| class.main().truth_count == 0) {
        let class = &class.rule.name;
        print_err(format_args!(
            "warning: no label of class {class} counts at moderate: its AP is 0 and means nothing"
        ));
    }
    let mut breakdowns = vec![Breakdown::by_range(&input.frames, &rules)];
    if let Some(rings) = rings(&sources, &input.frames)? {
        breakdowns.push(Breakdown::by_rings(&input.frames, &rings, &rules));
    }
    if arguments.json {
        let mut object = report.to_json();
        for breakdown in breakdowns {
            object[format!("by_{}", breakdown.by)] = breakdown.to_json();
        }
        return print_out(format_args!("{object:#}"));
    }
    let objects = input.frames.iter().map(|frame| frame.detections.len());
    let breakdowns = breakdowns.iter().map(|b| format!("\n{}", b.to_table()));
    let text = report.to_table() + &breakdowns.collect::<String>();
    print_out(format_args!(
        "{} frames, {} detections\n\n{}",
        input.frames.len(),
        objects.sum::<usize>(),
        text.trim_end()
    ))
}
