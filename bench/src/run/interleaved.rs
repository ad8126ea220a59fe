//! Two builds or two refiners on the same frames, interleaved: A, B, B, A, each time from a fresh start, so that a machine that slowly changes treats both
//! alike. Each start is measured by a `mluc bench` of its own, because one program cannot observe two wire versions; the rounds of a side become one report.

use super::{compare, folder, folder::FOLDERS, folder::save, plan::Plan, progress, show};
use crate::report::{FrameRecord, HOPS, STAGES, comparison_table, report_of};
use anyhow::{Context, Result, ensure};
use mluc::{EXIT_WARNINGS, terminal::print_out};
use mluc_runtime::Shutdown;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};

struct Side {
    name: String,
    program: PathBuf,
    refiner: Option<String>,
    frames: Vec<FrameRecord>,
    /// The last round's report, with the noisiest round's `quiet`.
    facts: Value,
    warnings: Vec<String>,
}

/// The two sides: this program and another one, or the two named refiners.
fn sides(plan: &Plan) -> [Side; 2] {
    let side = |name: String, program: &Path, refiner: Option<String>| Side {
        name,
        program: program.to_path_buf(),
        refiner,
        frames: Vec::new(),
        facts: Value::Null,
        warnings: Vec::new(),
    };
    let own = plan.program.as_path();
    match (&plan.args.against, &plan.args.refiner[..]) {
        (Some(other), refiner) => {
            let refiner = refiner.first();
            [own, other].map(|mluc| side(mluc.display().to_string(), mluc, refiner.cloned()))
        }
        (None, both) => [0, 1].map(|n| side(both[n].clone(), own, Some(both[n].clone()))),
    }
}

pub(crate) fn interleaved(plan: &Plan) -> Result<ExitCode> {
    let out = &plan.args.out;
    folder::make(out)?;
    let progress = progress();
    let (mut sides, mut is_flawed) = (sides(plan), false);
    let all = 2 * plan.rounds;
    let asked = Shutdown::on_signals()?;
    for number in 0..all {
        let side = usize::from(matches!(number % 4, 1 | 2));
        let (own, round) = (&mut sides[side], number / 2);
        let text = format!("{}, {} of {all}", own.name, number + 1);
        show(&progress, f64::from(number) / f64::from(all), text);
        let folder = out.join(FOLDERS[side]).join(format!("round-{round}"));
        is_flawed |= own.measure(plan, &folder)?;
        ensure!(!asked.is_requested(), "interrupted: the rounds so far stay");
        own.add(&folder, round)?;
    }
    drop(progress);
    for (side, name) in sides.iter().zip(FOLDERS) {
        folder::write(&out.join(name), &side.report(plan), &side.frames)?;
    }
    let folders = FOLDERS.map(|name| out.join(name));
    let names = sides.each_ref().map(|side| side.name.as_str());
    let value = compare::compared(folders.each_ref().map(|folder| &**folder), names)?;
    let json = serde_json::to_string_pretty(&value)?;
    save(out, "comparison.json", json)?;
    let text = comparison_table(value)?;
    save(out, "comparison.txt", &text)?;
    print_out(text.trim())?;
    let [a, b] = folders.map(|folder| folder.join("report.html"));
    print_out(format_args!("reports: {}, {}", a.display(), b.display()))?;
    Ok(ExitCode::from(if is_flawed { EXIT_WARNINGS } else { 0 }))
}

impl Side {
    /// Measures one start of the processes; returns whether frames were lost or a stage was restarted.
    fn measure(&self, plan: &Plan, folder: &Path) -> Result<bool> {
        let mut command = Command::new(&plan.program);
        // `exec` ends the command when this process ends, for whatever reason.
        let own = std::process::id().to_string();
        command.args(["exec", "--supervised-by", &own, "--"]);
        command.arg(&self.program);
        command.args(["bench", "--rounds", "1", "--out"]);
        command.arg(folder).args(plan.shared_arguments());
        for (key, seconds) in [
            ("--seconds", plan.round_seconds()),
            ("--warm-up", plan.warm_up_seconds),
            ("--patience", plan.patience.as_secs_f64()),
        ] {
            command.args([key, &seconds.to_string()]);
        }
        if let Some(refiner) = &self.refiner {
            command.args(["--refiner", refiner]);
        }
        if let Some(scenario) = &plan.args.scenario {
            command.arg("--scenario").arg(scenario);
        }
        let program = self.program.display();
        let output = command.stdin(Stdio::null()).output();
        let output = output.with_context(|| format!("starting {program}"))?;
        let log = String::from_utf8_lossy(&output.stderr);
        ensure!(
            matches!(output.status.code(), Some(0 | 3)),
            "{program} bench ended with {}:\n{}",
            output.status,
            log.trim_end()
        );
        Ok(output.status.code() == Some(EXIT_WARNINGS.into()))
    }

    fn add(&mut self, folder: &Path, round: u32) -> Result<()> {
        let (mut facts, frames) = folder::read(folder)?;
        let own = |frame: FrameRecord| FrameRecord { round, ..frame };
        self.frames.extend(frames.into_iter().map(own));
        for warning in facts["warnings"].as_array().into_iter().flatten() {
            let text = warning.as_str().unwrap_or_default();
            self.warnings.push(format!("Round {round}: {text}"));
        }
        if compare::others(&self.facts) > compare::others(&facts) {
            facts["quiet"] = self.facts["quiet"].take();
        }
        self.facts = facts;
        Ok(())
    }

    /// Figures of all rounds; machine, processes and messages of the last one.
    fn report(&self, plan: &Plan) -> Value {
        let (mut report, facts) = (report_of(&self.frames), &self.facts);
        let own = plan.describe();
        for key in "title quiet machine build scenario".split(' ') {
            report[key] = facts[key].clone();
        }
        report["title"] = plan.title().into();
        for key in ["scans", "seconds", "rounds"] {
            report["scenario"][key] = own[key].clone();
        }
        for (stage, hop) in STAGES.into_iter().zip(HOPS) {
            report["stages"][stage]["resources"] = facts["stages"][stage]["resources"].clone();
            report["hops"][hop]["payload_bytes"] = facts["hops"][hop]["payload_bytes"].clone();
        }
        report["warnings"] = self.warnings.clone().into();
        report
    }
}
