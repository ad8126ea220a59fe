//! `mluc-lab evaluate ap`: detections of any program against labels.

use super::{compared::Compared, warn_unrecognized};
use crate::commands::terminal::{print_err, print_out};
use clap::Args;
use mluc_evaluate::{ApReport, Breakdown, ClassReport, UnknownProtocol, evaluate};
use mluc_evaluate::{input::rings, paired, render, unevaluated};
use serde_json::json;
use std::{fs::File, io::BufRead, io::BufReader, path::PathBuf};

/// Average precision as KITTI's object devkit computes it, and open-set figures.
///
/// Prints a table, or JSON with --json. Every labelled frame counts: one without detections counts with nothing found,
/// and a warning on stderr says how many there are. Detections of frames without labels are left out, with a warning.
///
/// Known classes are car, pedestrian and cyclist, those named in --iou, and any labelled class that a detection of kind
/// known names (not Van, Tram, Misc, Person_sitting); --classes names them exactly. Their overlaps are KITTI's (car
/// 0.7, pedestrian and cyclist 0.5), 0.7 for trucks and vans, 0.5 for others, unless --iou says otherwise.
///
/// The open-set figures are of volumes (3d) at moderate; map_known is the mean over the known classes that have labels.
/// `evaluate operating` says what objects lie on.
#[derive(Args)]
pub(crate) struct ApArguments {
    #[command(flatten)]
    compared: Compared,
    /// Folder of scans (velodyne), for AP by the rings on the object; needs --calib.
    #[arg(long, value_name = "DIR")]
    scans: Vec<PathBuf>,
    /// Detections of another model on the same frames, as many as --detections: the AP of both and their difference, each with its
    /// 95 % interval (paired bootstrap; scans are drawn one by one, so of scans of one drive it is too narrow).
    #[arg(long, value_name = "DIR|FILE.jsonl")]
    beside: Vec<PathBuf>,
    /// What an unknown object may be found on besides labels of unknown classes: literal, nothing; fair, trams, Misc, sitting
    /// persons, and regions without labels (DontCare), none of which is right or wrong.
    #[arg(long, value_enum, default_value_t, requires = "unknown")]
    unknown_protocol: UnknownProtocol,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: ApArguments) -> anyhow::Result<()> {
    let compared = &arguments.compared;
    let [expected, found] = [compared.labels.len(), arguments.beside.len()];
    anyhow::ensure!(
        found == 0 || found == expected,
        "expected as many --beside as --labels ({expected}), in the same order, found {found}"
    );
    let (sources, input) = compared.read(&compared.detections, &arguments.scans)?;
    warn_low_scores(compared.detections.iter().chain(&arguments.beside))?;
    let rules = compared.rules(&input, arguments.unknown_protocol)?;
    if !compared.request.unknown.is_empty() {
        for class in unevaluated(&input.frames, &rules) {
            print_err(format_args!(
                "warning: labels of class {class} count as background; if it is known, name it in --iou"
            ));
        }
    } else {
        let labels = input.frames.iter().flat_map(|frame| frame.labels.iter());
        warn_unrecognized(labels, &rules);
    }
    let report = evaluate(&input.frames, &rules);
    warn_few_labels(&report);
    let mut breakdowns = vec![Breakdown::by_range(&input.frames, &rules)];
    if let Some(rings) = rings(&sources, &input.frames)? {
        breakdowns.push(Breakdown::by_rings(&input.frames, &rings, &rules));
    }
    let mut pairs = json!([]);
    if !arguments.beside.is_empty() {
        let (_, beside) = compared.read(&arguments.beside, &[])?;
        pairs = paired([&input.frames, &beside.frames], &rules);
    }
    if arguments.json {
        let mut object = report.to_json();
        if !arguments.beside.is_empty() {
            object["beside"] = pairs;
        }
        for breakdown in breakdowns {
            object[format!("by_{}", breakdown.by)] = breakdown.to_json();
        }
        return print_out(format_args!("{object:#}"));
    }
    let objects = input.frames.iter().map(|frame| frame.detections.len());
    let breakdowns = breakdowns.iter().map(|b| format!("\n{}", b.to_table()));
    let pairs = render(include_str!("paired.txt"), json!({"pairs": pairs}));
    let text = report.to_table() + &breakdowns.collect::<String>() + &pairs;
    print_out(format_args!(
        "{} frames, {} detections\n\n{}",
        input.frames.len(),
        objects.sum::<usize>(),
        text.trim_end()
    ))
}

/// Warns of files of JSON lines whose objects of low scores were not published.
fn warn_low_scores<'a>(detections: impl Iterator<Item = &'a PathBuf>) -> anyhow::Result<()> {
    for path in detections.filter(|path| path.is_file()) {
        let mut lines = BufReader::new(File::open(path)?).lines();
        if lines.any(|line| line.is_ok_and(|line| line.contains("\"low_score\""))) {
            let path = path.display();
            print_err(format_args!(
                "warning: {path}: objects of low scores were left out, which lowers AP: write it with --profile all"
            ));
        }
    }
    Ok(())
}

/// Warns of classes with so few labels that their AP, or its value at recall positions, means little.
fn warn_few_labels(report: &ApReport) {
    let classes = report.classes.iter();
    for class in classes.filter(|class| class.main().truth_count == 0) {
        let class = &class.rule.name;
        print_err(format_args!(
            "warning: no label of class {class} counts at moderate: its AP is 0 and means nothing"
        ));
    }
    // As in the devkit: each recall position needs a separate found label.
    let few = |class: &&ClassReport| (1..41).contains(&class.main().truth_count);
    for class in report.classes.iter().filter(few) {
        let (class, count) = (&class.rule.name, class.main().truth_count);
        print_err(format_args!(
            "warning: {count} labels of class {class} count at moderate: with fewer than 41, R11 and R40 are capped; read `AP all points`"
        ));
    }
}
