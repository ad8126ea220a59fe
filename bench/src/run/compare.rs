//! `mluc bench compare A B`.

use super::{arguments::CompareArgs, folder};
use crate::report::{compare, comparison_table};
use anyhow::Result;
use mluc::terminal::print_out;
use serde_json::{Value, json};
use std::{path::Path, process::ExitCode};

/// Values that must be the same in two reports, or their difference means little.
const SAME: [(&str, &str); 6] = [
    ("/machine/processor", "processor"),
    ("/machine/cores_usable", "usable cores"),
    ("/machine/kernel", "kernel"),
    ("/machine/governor", "CPU governor"),
    ("/scenario/rate_hz", "rate"),
    ("/scenario/scans", "scans"),
];

pub(crate) fn compare_folders(args: &CompareArgs) -> Result<ExitCode> {
    let names = [&args.a, &args.b].map(|path| path.display().to_string());
    let value = compared([&args.a, &args.b], names.each_ref().map(|n| &**n))?;
    if args.json {
        print_out(&value)?;
    } else {
        print_out(comparison_table(value)?.trim_end())?;
    }
    Ok(ExitCode::SUCCESS)
}

/// Compares the reports in two folders; the result includes what weakens the comparison.
pub(crate) fn compared(folders: [&Path; 2], names: [&str; 2]) -> Result<Value> {
    let (a, frames_a) = folder::read(folders[0])?;
    let (b, frames_b) = folder::read(folders[1])?;
    let others = others(&a).max(others(&b)).clamp(0.0, 1.0);
    let comparison = compare([&frames_a, &frames_b], others)?;
    let mut value = serde_json::to_value(&comparison)?;
    value["sentence"] = json!(comparison.sentence());
    value["names"] = json!(names);
    value["notes"] = json!(notes([&a, &b]));
    Ok(value)
}

/// Notes on what weakens a comparison.
fn notes([a, b]: [&Value; 2]) -> Vec<String> {
    let mut notes = Vec::new();
    for (pointer, name) in SAME {
        let of = [a, b].map(|report| report.pointer(pointer));
        if of[0] != of[1] {
            let [a, b] = of.map(|value| value.map_or("not known".to_string(), Value::to_string));
            notes.push(format!("different {name}: {a} and {b}"));
        }
    }
    let [of_a, of_b] = [a, b].map(|report| 100.0 * others(report));
    if (of_a - of_b).abs() > 5.0 {
        notes.push(format!(
            "the machine was not equally quiet: other processes took {of_a:.0} % of it and {of_b:.0} %"
        ));
    }
    if a.pointer("/build/binary") == b.pointer("/build/binary") {
        notes.push("both ran the same program, byte for byte".to_string());
    }
    notes
}

/// Share of all cores that other processes took.
pub(super) fn others(report: &Value) -> f64 {
    let share = report.pointer("/quiet/other_processes_share_of_all_cores");
    share.and_then(Value::as_f64).unwrap_or(0.0)
}
