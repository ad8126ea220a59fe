//! The common parts of the suites: their cases, which run one after the other on each program, and the command line.

use crate::program::{Options, Program, Tested};
use crate::report::{Report, Verdict};
use anyhow::{Context, bail, ensure};
use clap::Args;
use mluc::{EXIT_FAILURE, UsageError, settings::DEFAULT_MODEL, settings::Settings};
use mluc::{external::installed_program, model::load, stages::describe_run, terminal::print_out};
use mluc_geometry::Random;
use mluc_ipc_types::{FrameHeader, RunDescription, Stage, WIRE_VERSION};
use mluc_runtime::{
    Instance, Membership, Shell, Shutdown, log_to_stderr, monotonic_ns, random_run_id,
};
use std::{process::ExitCode, time::Duration, time::Instant};

/// If the case passed: what was seen. If it failed: the reason.
pub(crate) type Outcome = anyhow::Result<String>;

/// A part of the contract, by name.
pub(crate) type Case<S> = (&'static str, fn(&mut S) -> Outcome);

/// One program under test, and the stages around it.
pub(crate) struct Session<P> {
    pub(crate) tested: Tested,
    pub(crate) player: P,
}

/// Plays the stages around one program.
pub(crate) trait Suite: Sized + 'static {
    /// The cases in the order in which they run; the first one starts the program.
    const CASES: &'static [Case<Session<Self>>];
    /// `NAME: what the contract requires there`, one line per case.
    const ASKS: &'static str;

    fn new(instance: &Instance, options: &Options) -> anyhow::Result<Self>;

    /// Brings the program into operation before a case begins.
    fn ready(session: &mut Session<Self>) -> anyhow::Result<()>;
}

/// Options of every suite.
#[derive(Args, Clone, Debug)]
pub(crate) struct SuiteArgs {
    /// Model whose classes the messages have: built in or a model file.
    #[arg(long, default_value = DEFAULT_MODEL)]
    pub(crate) model: String,
    /// Only these cases; all when none is named.
    #[arg(long = "case", value_name = "NAME")]
    cases: Vec<String>,
    /// How long a start or an answer may take, s.
    #[arg(long, default_value = "10", value_parser = patience)]
    patience_s: Duration,
    /// JSON on stdout.
    #[arg(long)]
    json: bool,
    /// The program and its arguments.
    #[arg(last = true)]
    pub(crate) command: Vec<String>,
}

fn patience(text: &str) -> Result<Duration, String> {
    let seconds: Option<f64> = text.parse().ok();
    let seconds = seconds.filter(|seconds| (0.1..=600.0).contains(seconds));
    let seconds = seconds.ok_or("expected 0.1 to 600 seconds")?;
    Ok(Duration::from_secs_f64(seconds))
}

/// Describes a new run, whose sequences begin at 0.
pub(crate) fn begin_run(shell: &mut Shell, run: &mut RunDescription) -> anyhow::Result<()> {
    run.run_id = random_run_id();
    let is_ours = shell.begin_run(run)?;
    let others = "another process describes the run of this instance";
    ensure!(is_ours, others);
    Ok(())
}

/// Sets a stage's three stamps to the current time.
pub(crate) fn stamp(header: &mut FrameHeader, stage: Stage) {
    let now_ns = monotonic_ns();
    let stamps = header.stamps_mut(stage);
    (stamps.received_ns, stamps.started_ns) = (now_ns, now_ns);
    stamps.published_ns = now_ns;
}

/// Judges programs; each has a title.
pub(crate) fn run<S: Suite>(
    args: &SuiteArgs,
    programs: Vec<(String, Vec<String>)>,
) -> anyhow::Result<ExitCode> {
    let names: Vec<&str> = S::CASES.iter().map(|(name, _)| *name).collect();
    let is_unknown = |name: &&String| !names.contains(&name.as_str());
    if let Some(found) = args.cases.iter().find(is_unknown) {
        let expected = names.join(", ");
        let what = format!("--case: expected one of {expected}, found {found}");
        return Err(UsageError(what).into());
    }
    log_to_stderr("contract", "warn");
    let (model, shutdown) = (load(&args.model)?, Shutdown::on_signals()?);
    let mut reports = Vec::new();
    for (title, command) in programs {
        let options = Options {
            title,
            command,
            run: describe_run(&Settings::default(), &model),
            patience: args.patience_s,
            shutdown: shutdown.clone(),
        };
        let report = judge::<S>(options, &args.cases)?;
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

/// Skips the other cases if the program never became ready: all would fail for the same reason.
fn judge<S: Suite>(options: Options, wanted: &[String]) -> anyhow::Result<Report> {
    let title = options.title.clone();
    let tested = Tested::new(options)?;
    let player = S::new(&tested.instance, &tested.options)?;
    let mut session = Session { tested, player };
    let is_wanted = |name: &str| wanted.is_empty() || wanted.iter().any(|word| word == name);
    let mut cases = S::CASES.iter().filter(|(name, _)| is_wanted(name));
    let (mut verdicts, mut not_run) = (Vec::new(), 0);
    while let Some(&(name, act)) = cases.next() {
        let begun = Instant::now();
        let is_first = name == S::CASES[0].0;
        let is_ready = if is_first { Ok(()) } else { S::ready(&mut session) };
        let result = is_ready.and_then(|()| act(&mut session));
        session.tested.check_uninterrupted()?;
        let passed = result.is_ok();
        let prefix = format!("{name}: ");
        let asks = S::ASKS.lines().find_map(|line| line.strip_prefix(&prefix));
        verdicts.push(Verdict {
            name,
            asks: asks.expect("a line for every case"),
            passed,
            what: result.unwrap_or_else(|error| format!("{error:#}")),
            ms: begun.elapsed().as_millis() as u64,
        });
        if !passed {
            // The next case begins with a fresh process.
            session.tested.stop();
            if !session.tested.was_ready {
                not_run = cases.by_ref().count();
            }
        }
    }
    Ok(Report::new(title, verdicts, not_run))
}

/// Judges the program of the command line, as `mluc up` starts it.
pub(crate) fn run_command<S: Suite>(args: &SuiteArgs) -> anyhow::Result<ExitCode> {
    let words: Vec<&str> = args.command.iter().map(String::as_str).collect();
    if words.is_empty() {
        return Err(UsageError("expected -- COMMAND, found none".to_string()).into());
    }
    let command = supervised(&["exec"], &[&["--"], &words[..]].concat());
    run::<S>(args, vec![(words.join(" "), command)])
}

/// `mluc WORDS`, tied to this process, followed by the words of `more`.
pub(crate) fn supervised(words: &[&str], more: &[&str]) -> Vec<String> {
    let program = installed_program("mluc").display().to_string();
    let supervisor = std::process::id().to_string();
    let tie = ["--supervised-by", &supervisor];
    [&[&*program], words, &tie, more].concat().into_iter().map(str::to_string).collect()
}

/// Whether a text names this wire version and the other one.
pub(crate) fn names_both(text: &str, other: u32) -> bool {
    let numbers: Vec<&str> = text.split(|c: char| !c.is_ascii_digit()).collect();
    let versions = [WIRE_VERSION, other].map(|version| version.to_string());
    versions.iter().map(String::as_str).all(|version| numbers.contains(&version))
}

/// Starts the program in an instance whose contract file names another version; returns the program's message.
pub(crate) fn wrong_instance(options: &Options) -> anyhow::Result<String> {
    let instance = Instance::new(&format!("w-{}", std::process::id()))?;
    let member = Membership::join(&instance, "suite")?;
    let (other, pid) = (WIRE_VERSION + 41, std::process::id());
    let text = format!("wire={other} version=99.0.0 by=ingest pid={pid}\n");
    std::fs::write(instance.root().join("contract"), text).context("writing the contract file")?;
    let mut program = Program::start(&options.command, &instance)?;
    let ended = program.end_within(options.patience);
    let words = program.last_words()?;
    drop(program);
    drop(member);
    let place = format!("an instance of wire version {other}");
    match ended {
        None => bail!("it joined {place} and stayed"),
        Some(status) if status.success() => bail!("it left {place} without an error"),
        Some(_) if names_both(&words, other) => {
            Ok(words.lines().last().unwrap_or("").trim().to_string())
        }
        Some(_) => bail!("it left {place} without naming both versions on stderr: {words}"),
    }
}

/// Overwrites elements with noise.
pub(crate) fn fill<T: bytemuck::Pod>(random: &mut Random, elements: &mut [T]) {
    for byte in bytemuck::cast_slice_mut::<T, u8>(elements) {
        *byte = random.bits() as u8;
    }
}
