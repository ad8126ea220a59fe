//! `mluc-lab evaluate operating`: the false objects per scan, and the share of labels that are found.

use super::{compared::Compared, warn_unlabelled, warn_unrecognized};
use crate::commands::terminal::print_out;
use clap::Args;
use mluc_dataset::Label;
use mluc_evaluate::{Breakdown, ClassRule, Operating, Tracks, UnknownProtocol};

/// Objects per scan and per hour at 10 Hz, how many of them lie on no label, and recall: as published, and as a curve over the score.
///
/// An object lies on a label when its centre is in the label's footprint, grown by 0.5 m on every side. Counted are objects and labels
/// within 70 m (--range-max-m: less) and in the image; objects in regions without labels (DontCare) are left out unless they lie on a label. A label is found as for `evaluate ap`, at
/// moderate. Each --labels folder is one drive: the 95 % intervals come from drawing drives, and in each runs of ten scans.
///
/// `at most N`: the lowest score that leaves at most N objects per scan on no label on these very scans. The curve goes down to what is in
/// the detections: `mluc up --profile all` publishes everything. With `mluc up --track` tracks are counted too: one is one alarm.
#[derive(Args)]
pub(crate) struct OperatingArguments {
    #[command(flatten)]
    compared: Compared,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: OperatingArguments) -> anyhow::Result<()> {
    let compared = &arguments.compared;
    let (_, input) = compared.read(&compared.detections, &[])?;
    let mut rules = compared.rules(&input, UnknownProtocol::default())?;
    let labels = input.frames.iter().flat_map(|frame| frame.labels.iter());
    warn_unrecognized(labels.clone(), &rules);
    for name in &compared.request.classes {
        let is_of = |label: &Label| label.class.eq_ignore_ascii_case(name);
        if !labels.clone().any(is_of) {
            warn_unlabelled("classes", name);
        }
    }
    let operating = Operating::of(&input.frames, &input.counts, &rules);
    let tracks = Tracks::of(&input.frames, &input.counts, &rules);
    // Also each merged class alone: an object on a label of another merged class is then neither right nor wrong.
    let merged = rules.iter().filter(|rule| rule.valid.len() > 1);
    let class = |rule: &ClassRule, name: &String| ClassRule {
        name: name.clone(),
        valid: vec![name.clone()],
        ignored: [&rule.valid[..], &rule.ignored].concat(),
        ..rule.clone()
    };
    let single = merged.flat_map(|rule| rule.valid.iter().map(move |name| class(rule, name)));
    rules.extend(single.collect::<Vec<_>>());
    let by_range = Breakdown::by_range(&input.frames, &rules);
    if arguments.json {
        let mut object = operating.to_json();
        object["by_range"] = by_range.to_json();
        object["tracks"] = serde_json::json!(tracks);
        return print_out(format_args!("{object:#}"));
    }
    let tracks = tracks.map_or(String::new(), |tracks| format!("{tracks}\n\n"));
    let text = format!("{}\n{tracks}{}", operating.to_table(), by_range.to_table());
    print_out(text.trim_end())
}
