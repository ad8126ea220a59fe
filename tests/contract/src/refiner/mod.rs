//! The suite of the refiner: plays ingest, backbone and head over the same shared memory as the real stages, and looks at
//! what comes back. [`judge`] runs the cases on one program.

mod answer;
mod cases;
mod player;
mod scene;
mod session;

use std::process::ExitCode;
use std::time::{Duration, Instant};

use clap::Args;
use clap::builder::PossibleValuesParser;
use mluc::EXIT_FAILURE;
use mluc::external::installed_program;
use mluc::model::load;
use mluc::settings::{DEFAULT_MODEL, Settings};
use mluc::stages::describe_run;
use mluc::terminal::print_out;
use mluc_refiner::Variant;
use mluc_runtime::{Shutdown, log_to_stderr};

use crate::program::Options;
use crate::report::{Report, Verdict};
use session::Session;

#[derive(Args, Clone, Debug)]
pub(crate) struct RefinerArgs {
    /// Model whose classes the detections have: built in or a model file.
    #[arg(long, default_value = DEFAULT_MODEL)]
    model: String,
    /// Only these cases; all when none is named.
    #[arg(long = "case", value_name = "NAME", value_parser = PossibleValuesParser::new(cases::CASES.map(|case| case.name)))]
    cases: Vec<String>,
    /// Only this mode of our own refiner.
    #[arg(long, value_name = "MODE", conflicts_with = "command")]
    refiner_mode: Option<String>,
    /// How long a start or an answer may take, s.
    #[arg(long, default_value = "10", value_parser = patience)]
    patience_s: Duration,
    /// JSON on stdout.
    #[arg(long)]
    json: bool,
    /// The program and its arguments.
    #[arg(last = true)]
    command: Vec<String>,
}

fn patience(text: &str) -> Result<Duration, String> {
    let seconds: Option<f64> = text.parse().ok();
    let seconds = seconds.filter(|seconds| (0.1..=600.0).contains(seconds));
    let seconds = seconds.ok_or("expected 0.1 to 600 seconds")?;
    Ok(Duration::from_secs_f64(seconds))
}

pub(crate) fn run(args: RefinerArgs) -> anyhow::Result<ExitCode> {
    log_to_stderr("refiner-test", "warn");
    let (model, shutdown) = (load(&args.model)?, Shutdown::on_signals()?);
    let options = |(title, command)| Options {
        title,
        command,
        run: describe_run(&Settings::default(), &model),
        patience: args.patience_s,
        shutdown: shutdown.clone(),
    };
    let programs = programs(&args).into_iter().map(options);
    let mut reports = Vec::new();
    for options in programs {
        let report = judge(&options, &args.cases)?;
        if !args.json {
            print_out(report.text().trim_end())?;
        }
        reports.push(report);
    }
    if args.json {
        print_out(serde_json::to_string(&reports)?)?;
    }
    let is_passed = reports.iter().all(Report::is_passed);
    Ok(ExitCode::from(if is_passed { 0 } else { EXIT_FAILURE }))
}

/// Runs the suite. A program that never became ready is not asked for more: every case would fail for the same reason.
fn judge(options: &Options, wanted: &[String]) -> anyhow::Result<Report> {
    let mut session = Session::new(options, "suite")?;
    let is_wanted = |name: &str| wanted.is_empty() || wanted.iter().any(|word| word == name);
    let mut cases = cases::CASES.iter().filter(|case| is_wanted(case.name));
    let (mut verdicts, mut not_run) = (Vec::new(), 0);
    while let Some(case) = cases.next() {
        let begun = Instant::now();
        // Only the start is no program's that waits for frames.
        let is_ready = match case.name {
            "start" => Ok(()),
            _ => session.ready(),
        };
        let result = is_ready.and_then(|()| (case.run)(&mut session));
        session.player.check_running()?;
        let passed = result.is_ok();
        verdicts.push(Verdict {
            name: case.name,
            asks: case.asks(),
            passed,
            what: result.unwrap_or_else(|error| format!("{error:#}")),
            ms: begun.elapsed().as_millis() as u64,
        });
        if !passed {
            // The next case begins with a fresh process.
            session.stop_program();
            if !session.was_ready {
                not_run = cases.by_ref().count();
            }
        }
    }
    Ok(Report::new(options.title.clone(), verdicts, not_run))
}

/// Title and command of the user's program, or of ours in each mode asked for; as `mluc up` starts them.
fn programs(args: &RefinerArgs) -> Vec<(String, Vec<String>)> {
    let command: Vec<&str> = args.command.iter().map(String::as_str).collect();
    match &args.refiner_mode {
        _ if !command.is_empty() => {
            let words = supervised(&["exec"], &[&["--"], &command[..]].concat());
            vec![(command.join(" "), words)]
        }
        Some(mode) => vec![own(args, mode)],
        None => Variant::ALL.map(|mode| own(args, mode.name())).into(),
    }
}

fn own(args: &RefinerArgs, mode: &str) -> (String, Vec<String>) {
    let model = ["--model", &args.model];
    let words = [["stage", "refiner"], model, ["--refiner-mode", mode]];
    let title = format!("mluc stage refiner, mode {mode}");
    (title, supervised(words.as_flattened(), &[]))
}

/// `mluc WORDS` tied to this process, then `more` words.
fn supervised(words: &[&str], more: &[&str]) -> Vec<String> {
    let program = installed_program("mluc").display().to_string();
    let supervisor = std::process::id().to_string();
    let tie = ["--supervised-by", &supervisor];
    let words = [&[&*program], words, &tie, more].concat();
    words.into_iter().map(str::to_string).collect()
}
