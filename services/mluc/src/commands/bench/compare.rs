//! `mluc bench compare A B`.

use std::process::ExitCode;

use mluc_report::{CompareOptions, Verdict, compare};
use serde_json::{Value, json};

use super::arguments::CompareArgs;
use super::folder;
use crate::terminal::answer;
use crate::{EXIT_WARNINGS, UsageError};

/// What should be the same in two reports for their difference to mean anything.
const SAME: [(&str, &str); 6] = [
    ("/machine/processor", "processor"),
    ("/machine/cores_usable", "usable cores"),
    ("/machine/kernel", "kernel"),
    ("/machine/governor", "CPU governor"),
    ("/scenario/rate_hz", "rate"),
    ("/scenario/scans", "scans"),
];

pub(super) fn compare_folders(args: &CompareArgs) -> anyhow::Result<ExitCode> {
    if !(0.0..1.0).contains(&args.margin) {
        return Err(UsageError(format!(
            "--margin must be 0 to below 1, found {}",
            args.margin
        ))
        .into());
    }
    let (a, frames_a) = folder::read(&args.a)?;
    let (b, frames_b) = folder::read(&args.b)?;
    let bare = |report: &Value| report.pointer("/instrumentation/stamps") == Some(&json!("off"));
    let options = CompareOptions {
        margin: args.margin,
        end_to_end_only: bare(&a) || bare(&b),
        ..CompareOptions::on_machines([others(&a), others(&b)])
    };
    let comparison = compare(&frames_a, &frames_b, &options)?;
    let notes = notes(&a, &b);
    if args.json {
        let mut value = serde_json::to_value(&comparison)?;
        value["sentence"] = json!(comparison.sentence());
        value["notes"] = json!(notes);
        answer(&value)?;
    } else {
        let names = [&args.a, &args.b].map(|path| path.display().to_string());
        answer(
            comparison
                .table(names.each_ref().map(String::as_str))
                .trim_end(),
        )?;
        for note in &notes {
            answer(format_args!("note: {note}"))?;
        }
    }
    let is_higher = comparison
        .rows
        .iter()
        .any(|row| row.verdict == Verdict::Higher);
    Ok(ExitCode::from(if args.fail_if_higher && is_higher {
        EXIT_WARNINGS
    } else {
        0
    }))
}

/// What makes a comparison weak.
fn notes(a: &Value, b: &Value) -> Vec<String> {
    let mut notes = Vec::new();
    for (pointer, name) in SAME {
        let (of_a, of_b) = (a.pointer(pointer), b.pointer(pointer));
        if of_a != of_b {
            let text =
                |value: Option<&Value>| value.map_or("not told".to_string(), Value::to_string);
            notes.push(format!(
                "different {name}: {} and {}",
                text(of_a),
                text(of_b)
            ));
        }
    }
    let (of_a, of_b) = (others(a), others(b));
    if (of_a - of_b).abs() > 0.05 {
        notes.push(format!(
            "the machine was not equally quiet: other processes took {:.0} % of it and {:.0} %",
            100.0 * of_a,
            100.0 * of_b
        ));
    }
    if a.pointer("/build/binary") == b.pointer("/build/binary") {
        notes.push("both ran the same program, byte for byte".to_string());
    }
    notes
}

/// Share of all cores that others took.
fn others(report: &Value) -> f64 {
    let share = report.pointer("/quiet/other_processes_share_of_all_cores");
    share.and_then(Value::as_f64).unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_makes_a_comparison_weak_is_said() {
        let of = |kernel: &str, others: f64, binary: &str| json!({"machine": {"kernel": kernel}, "quiet": {"other_processes_share_of_all_cores": others}, "build": {"binary": binary}});
        assert!(notes(&of("6.1", 0.01, "a"), &of("6.1", 0.02, "b")).is_empty());
        let notes = notes(&of("6.1", 0.01, "a"), &of("6.2", 0.30, "a"));
        assert_eq!(notes.len(), 3, "{notes:?}");
        assert!(notes[0].contains("kernel") && notes[1].contains("30 %"));
    }
}
