//! `mluc refiner-test`: the contract suite on any program, or on our own refiner in all modes.

use std::process::ExitCode;
use std::time::Duration;

use anyhow::Context;
use clap::Args;
use mluc_refiner::Mode;
use mluc_refiner_suite::{Options, Report, case_names, compare_latency, run};
use mluc_runtime::{Shutdown, log_to_stderr};

use crate::nearest::nearest;
use crate::terminal::answer;
use crate::{EXIT_FAILURE, UsageError, model};

#[derive(Args, Clone, Debug)]
pub(crate) struct RefinerTestArgs {
    /// Model whose classes the detections have: embedded (kitti, kitti-open, udi, udi-open) or a model file.
    #[arg(long, default_value = "kitti")]
    pub(crate) model: String,
    /// Only these cases; all when none is named.
    #[arg(long = "case", value_name = "NAME")]
    pub(crate) cases: Vec<String>,
    /// Only this mode of our own refiner.
    #[arg(long, value_name = "MODE", conflicts_with = "command")]
    pub(crate) refiner_mode: Option<String>,
    /// How long a start or an answer may take, s.
    #[arg(long, default_value_t = 10.0)]
    pub(crate) patience_s: f64,
    /// Measure what a hop costs beside our own refiner, instead of the suite.
    #[arg(long)]
    pub(crate) latency: bool,
    /// Frames for --latency.
    #[arg(long, default_value_t = 500, requires = "latency")]
    pub(crate) frames: usize,
    /// JSON on stdout.
    #[arg(long)]
    pub(crate) json: bool,
    /// The program and its arguments.
    #[arg(last = true)]
    pub(crate) command: Vec<String>,
}

/// Between two frames of --latency; long enough that both programs sleep when the next one comes.
const PERIOD: Duration = Duration::from_millis(10);

pub(crate) fn refiner_test(args: RefinerTestArgs) -> anyhow::Result<ExitCode> {
    log_to_stderr("refiner-test", "warn");
    check(&args)?;
    let tester = Tester::new(&args)?;
    if args.latency {
        return latency(&args, &tester);
    }
    let mut reports = Vec::new();
    for options in tester.all()? {
        let report = run(&options)?;
        if !args.json {
            answer(report.text().trim_end())?;
        }
        reports.push(report);
    }
    if args.json {
        answer(serde_json::to_string(&reports)?)?;
    }
    let is_passed = reports.iter().all(Report::is_passed);
    Ok(ExitCode::from(if is_passed { 0 } else { EXIT_FAILURE }))
}

fn check(args: &RefinerTestArgs) -> Result<(), UsageError> {
    let names = case_names();
    for case in &args.cases {
        if !names.contains(&case.as_str()) {
            let hint = nearest(case, names.iter().copied())
                .map_or(String::new(), |near| format!("; did you mean '{near}'?"));
            return Err(UsageError(format!(
                "no case '{case}': there are {}{hint}",
                names.join(", ")
            )));
        }
    }
    match (0.1..=600.0).contains(&args.patience_s) && (1..=1_000_000).contains(&args.frames) {
        true => Ok(()),
        false => Err(UsageError(
            "patience-s must be 0.1 to 600, frames 1 to 1000000".to_string(),
        )),
    }
}

fn latency(args: &RefinerTestArgs, tester: &Tester) -> anyhow::Result<ExitCode> {
    let reference = tester.own(Mode::default().name())?;
    let program = match args.command.is_empty() {
        true => tester.own(&tester.modes()[0])?,
        false => tester.foreign()?,
    };
    let report = compare_latency(&reference, &program, args.frames, PERIOD)?;
    match args.json {
        true => answer(serde_json::to_string(&report)?)?,
        false => answer(report.text().trim_end())?,
    }
    Ok(ExitCode::SUCCESS)
}

/// What all programs are tested with.
struct Tester {
    args: RefinerTestArgs,
    own_program: String,
    classes: Vec<String>,
    fingerprint: u64,
    shutdown: Shutdown,
}

impl Tester {
    fn new(args: &RefinerTestArgs) -> anyhow::Result<Tester> {
        let model = model::load(&args.model)?;
        let own_program = std::env::current_exe().context("finding this program's file")?;
        Ok(Tester {
            args: args.clone(),
            own_program: own_program.display().to_string(),
            classes: model::class_names(&model),
            fingerprint: model.fingerprint,
            shutdown: Shutdown::on_signals()?,
        })
    }

    fn modes(&self) -> Vec<String> {
        match &self.args.refiner_mode {
            Some(mode) => vec![mode.clone()],
            None => Mode::ALL.map(|mode| mode.name().to_string()).to_vec(),
        }
    }

    fn all(&self) -> anyhow::Result<Vec<Options>> {
        match self.args.command.is_empty() {
            false => Ok(vec![self.foreign()?]),
            true => self.modes().iter().map(|mode| self.own(mode)).collect(),
        }
    }

    /// Our own refiner, as `mluc up` starts it.
    fn own(&self, mode: &str) -> anyhow::Result<Options> {
        let command = ["stage", "refiner", "--model", &self.args.model];
        let mut words = vec![self.own_program.clone()];
        words.extend(command.map(str::to_string));
        words.extend(["--refiner-mode".to_string(), mode.to_string()]);
        let supervisor = std::process::id().to_string();
        words.extend(["--supervised-by".to_string(), supervisor]);
        let command = move |instance: &str| {
            let mut words = words.clone();
            words.extend(["--instance".to_string(), instance.to_string()]);
            words
        };
        Ok(self.options(format!("mluc stage refiner, mode {mode}"), command))
    }

    /// The user's program, as `mluc up` starts it: first ours, which ties it to this process.
    fn foreign(&self) -> anyhow::Result<Options> {
        let supervisor = std::process::id().to_string();
        let mut words = vec![self.own_program.clone()];
        words.extend(["exec", "--supervised-by", &supervisor, "--"].map(str::to_string));
        words.extend(self.args.command.iter().cloned());
        let title = self.args.command.join(" ");
        Ok(self.options(title, move |_: &str| words.clone()))
    }

    fn options(&self, title: String, command: impl Fn(&str) -> Vec<String> + 'static) -> Options {
        Options {
            title,
            command: Box::new(command),
            classes: self.classes.clone(),
            fingerprint: self.fingerprint,
            model: self.args.model.clone(),
            cases: self.args.cases.clone(),
            patience: Duration::from_secs_f64(self.args.patience_s),
            shutdown: self.shutdown.clone(),
        }
    }
}
