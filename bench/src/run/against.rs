//! This build and another one on the same frames, interleaved. Each side is measured by its own `mluc bench`, because one
//! program cannot observe two wire versions; the rounds of a side become one report.

use std::path::Path;
use std::process::{Command, ExitCode, Stdio};

use anyhow::{Context, Result, ensure};
use mluc::{EXIT_WARNINGS, UsageError};
use serde_json::Value;

use super::compare::{notes, options};
use super::folder::{self, FOLDERS};
use super::local::turn;
use super::plan::Plan;
use super::{progress, show};
use crate::report::{FrameRecord, compare, number, report_of};

#[derive(Default)]
struct Side {
    frames: Vec<FrameRecord>,
    /// The last round's facts of machine, build and scenario.
    facts: Value,
    warnings: Vec<String>,
}

pub(crate) fn against(plan: &Plan, other: &Path) -> Result<ExitCode> {
    if plan.variants.len() > 1 {
        let text = "--against and two --refiner cannot be told apart: one after the other, please";
        return Err(UsageError(text.to_string()).into());
    }
    let out = &plan.args.out;
    folder::make(out)?;
    let programs = [plan.program.as_path(), other];
    let progress = progress();
    let mut sides = [Side::default(), Side::default()];
    let all = 2 * plan.rounds;
    for number in 0..all {
        let (turn, round) = (turn(number), number / 2);
        let program = programs[turn];
        let text = format!("{}, {} of {all}", program.display(), number + 1);
        show(&progress, f64::from(number) / f64::from(all), text);
        let folder = out.join(FOLDERS[turn]).join(format!("round-{round}"));
        measure(plan, program, &folder)?;
        sides[turn].add(&folder, round)?;
    }
    drop(progress);
    let mut is_flawed = false;
    for (side, name) in sides.iter().zip(FOLDERS) {
        let report = side.report();
        is_flawed |= number(&report, "/frames/dropped") > Some(0.0);
        folder::write(&out.join(name), &report, &side.frames, &[])?;
    }
    let facts = [&sides[0].facts, &sides[1].facts];
    let frames = sides.each_ref().map(|side| &side.frames[..]);
    let comparison = compare(frames, &options(facts))?;
    let names = programs.map(|program| program.display().to_string());
    let names = names.each_ref().map(String::as_str);
    let mut value = serde_json::to_value(&comparison)?;
    value["notes"] = notes(facts).into();
    folder::write_comparison(out, names, &comparison, "", value)?;
    Ok(ExitCode::from(if is_flawed { EXIT_WARNINGS } else { 0 }))
}

/// One start of a build's processes, by its own `mluc bench`.
fn measure(plan: &Plan, program: &Path, folder: &Path) -> Result<()> {
    let mut command = Command::new(program);
    command.args(["bench", "--rounds", "1", "--floor-rounds", "0", "--out"]);
    command.arg(folder).args(plan.shared_arguments());
    for (key, seconds) in [
        ("--seconds", plan.round_seconds()),
        ("--warm-up", plan.warm_up_seconds),
        ("--patience", plan.patience.as_secs_f64()),
    ] {
        command.args([key, &seconds.to_string()]);
    }
    if let Some(refiner) = plan.args.refiner.first() {
        command.args(["--refiner", refiner]);
    }
    if let Some(scenario) = &plan.args.scenario {
        command.arg("--scenario").arg(scenario);
    }
    let output = command.stdin(Stdio::null()).output();
    let output = output.with_context(|| format!("starting {}", program.display()))?;
    let log = String::from_utf8_lossy(&output.stderr);
    ensure!(
        matches!(output.status.code(), Some(0 | 3)),
        "{} bench ended with {}:\n{}",
        program.display(),
        output.status,
        log.trim_end()
    );
    Ok(())
}

impl Side {
    fn add(&mut self, folder: &Path, round: u32) -> Result<()> {
        let (facts, frames) = folder::read(folder)?;
        let own = frames.into_iter();
        self.frames
            .extend(own.map(|frame| FrameRecord { round, ..frame }));
        for warning in facts["warnings"].as_array().into_iter().flatten() {
            let text = warning.as_str().unwrap_or_default();
            self.warnings.push(format!("Round {round}: {text}"));
        }
        self.facts = facts;
        Ok(())
    }

    /// Figures of all rounds, facts of the last one.
    fn report(&self) -> Value {
        let mut report = report_of(&self.frames);
        for key in "title quiet machine build scenario instrumentation".split(' ') {
            report[key] = self.facts[key].clone();
        }
        report["warnings"] = self.warnings.clone().into();
        report
    }
}
