//! The process of each stage, whose own file calls the algorithm, and the description of a run for all stages and consumers.

mod backbone;
mod head;
mod ingest;
mod models;
pub(crate) mod played;
mod refiner;

use crate::{UsageError, model, placement::lock_memory, placement::pin};
use crate::{cli::StageArgs, external::external, resolve::Resolved, settings::Settings};
use anyhow::{Context, bail};
use mluc_head::gate::{main_gate, threshold_of};
use mluc_ipc_types::{CLASS_NAME_MAX, CLASSES_MAX, RunDescription, Stage, Text, WIRE_VERSION};
use mluc_model::{HeadKind, Model};
use mluc_runtime::{Shell, Shutdown, log_to_stderr, random_run_id, wall_clock_ns};
use mluc_sources::{Open, Source};
use rustix::process::{Signal, getppid, set_parent_process_death_signal};
use std::{process::Command, time::Duration};

/// Runs a stage's process until it is asked to end. `open`: opens the input, for a program that knows more inputs than `mluc`.
pub fn run(args: StageArgs, open: Option<Open>) -> anyhow::Result<()> {
    let stage = Stage::from_name(&args.name).context("stage")?;
    log_to_stderr(stage.name(), "info");
    if let Some(parent) = args.supervised_by {
        // A reload is the supervisor's: a SIGHUP to all processes of the pipeline does nothing here.
        let _ignored = mluc_runtime::reload_flag()?;
        end_with(parent)?;
    }
    let mut settings = Resolved::of(args.pipeline, true)?.settings;
    if open.is_none() && stage == Stage::Ingest && settings.reads_ros2() {
        // It only returns when the program is not there. Another start would fail too, so this is a usage error.
        let started = external("mluc-ros2", &["stage"]).map(drop);
        return started.map_err(|error| UsageError(format!("{error:#}")).into());
    }
    if let Some(level) = settings.level()? {
        level.restrict();
    }
    // Set before any thread is started: all threads inherit it.
    let own = &settings.stages[stage];
    if let Some(cpus) = &own.cpus {
        pin(cpus)?;
    }
    // A stage that the supervisor started has its priority since the start.
    if let (Some(priority), None) = (own.priority, args.supervised_by) {
        let numbers = [u32::from(priority), std::process::id()].map(|n| n.to_string());
        let mut chrt = Command::new("chrt");
        let _ = chrt.args(["-f", "-p"]).args(numbers).output();
        if let Err(error) = own.check_right(stage.name()) {
            tracing::warn!("{error}; the stage runs without it");
        }
    }
    if own.lock_memory
        && let Err(why) = lock_memory()
    {
        tracing::warn!("lock_memory: {why}; without it memory may be paged out");
    }
    // This thread belongs to the pool: a thread that enters a pool from outside waits for it to wake up, and sometimes makes it allocate.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(own.threads);
    pool.use_current_thread().build_global().context("starting the threads")?;
    let shutdown = Shutdown::on_signals()?;
    let mut shell = Shell::stage(&settings.instance, stage, shutdown)?;
    shell.verify_mapping = settings.verify_mapping;
    shell.prefaults = own.prefault;
    let model = model::load_for(&settings)?;
    settings.complete_from(&model);
    let done = match stage {
        Stage::Ingest => {
            let open = open.unwrap_or(Source::open);
            let start_sequence = args.supervised_by.map(|_| args.start_sequence);
            ingest::run(&mut shell, &settings, &model, start_sequence, open)
        }
        Stage::Backbone | Stage::Head if args.played_to.is_some() => {
            played::run(&mut shell, &settings, &model, stage, args.played_to)
        }
        Stage::Backbone => {
            // A restarted stage does not warm up, because frames wait for it: its first frame is slower, but comes out earlier.
            let warms_up = args.start_sequence == 0;
            backbone::run(&mut shell, &settings, &model, warms_up)
        }
        Stage::Head => head::run(&mut shell, &model),
        Stage::Refiner => refiner::run(&mut shell, &settings, &model),
    };
    done.with_context(|| format!("stage {}", stage.name()))
}

/// Has the kernel send SIGTERM when the supervisor dies, for whatever reason.
pub fn end_with(parent: u32) -> anyhow::Result<()> {
    set_parent_process_death_signal(Some(Signal::TERM))
        .context("tying this process to its parent")?;
    // It may have died before the line above.
    let found = getppid().map_or(0, |pid| pid.as_raw_nonzero().get() as u32);
    if found != parent {
        bail!("the supervisor (process {parent}) is gone");
    }
    Ok(())
}

/// How long the process that began a run may take to describe it.
const PATIENCE: Duration = Duration::from_secs(3);

/// Begins a run, or joins the one that another process of the instance has begun. `None`: asked to end.
pub(crate) fn begin_or_join_run(
    shell: &mut Shell,
    settings: &Settings,
    model: &Model,
) -> anyhow::Result<Option<RunDescription>> {
    let own = describe_run(settings, model);
    if shell.begin_run(&own)? {
        return Ok(Some(own));
    }
    shell.await_run(PATIENCE)?;
    let instance = settings.instance.name();
    match shell.run() {
        _ if shell.is_stopping() => Ok(None),
        None => bail!("instance '{instance}': the process that began the run does not describe it"),
        Some(run) if run.model_fingerprint == own.model_fingerprint => Ok(Some(*run)),
        Some(run) => bail!(
            "instance '{instance}' runs the model '{}' (fingerprint {:016x}), this process '{}' ({:016x}): start all with \
             the same --model",
            run.model_name(),
            run.model_fingerprint,
            own.model_name(),
            own.model_fingerprint
        ),
    }
}

/// A new run's description.
pub fn describe_run(settings: &Settings, model: &Model) -> RunDescription {
    let (manifest, thresholds) = (&model.manifest, &model.manifest.thresholds);
    let is_open = manifest.network.head == HeadKind::Open;
    let gate = main_gate(is_open, thresholds);
    let mut class_names = [[0; CLASS_NAME_MAX]; CLASSES_MAX];
    for (to, class) in class_names.iter_mut().zip(&manifest.classes) {
        *to = Text::pack(&class.name);
    }
    RunDescription {
        wire_version: WIRE_VERSION,
        classes_count: manifest.classes.len() as u32,
        run_id: random_run_id(),
        started_ns: wall_clock_ns(),
        model_fingerprint: model.fingerprint,
        other_model_fingerprint: 0,
        base_from_sensor: settings.sensor.extrinsics.unwrap_or_default(),
        sensor_height_m: manifest.sensor_height_m,
        objectness_min: thresholds.objectness_min,
        gate: gate as u32,
        gate_threshold: threshold_of(gate, thresholds),
        model_name: Text::pack(&manifest.name),
        sensor_name: Text::pack(&settings.sensor.name),
        class_names,
        known_score: Text::pack("objectness x probability of the class, 0 to 1"),
        unknown_score: Text::pack(
            "orders unknown objects of one model and refiner among each other; no probability",
        ),
    }
}
