//! The process of each stage; its file holds the algorithm's call.

mod backbone;
mod description;
mod head;
mod ingest;
mod refiner;

use anyhow::{Context, bail};
use mluc_ipc_types::Stage;
use mluc_runtime::{Shell, Shutdown, log_to_stderr};
use rustix::process::{Signal, getppid, set_parent_process_death_signal};

use crate::cli::StageArgs;
use crate::model;
use crate::placement::pin;
use crate::resolve::Resolved;

pub(crate) use description::begin_or_join_run;
pub use description::describe_run;

pub(crate) fn run(args: StageArgs) -> anyhow::Result<()> {
    let stage = Stage::from_name(&args.name).context("stage")?;
    log_to_stderr(stage.name(), "info");
    if let Some(parent) = args.supervised_by {
        end_with(parent)?;
    }
    let settings = Resolved::of(args.pipeline, true)?.settings;
    // Before any thread is started: they all inherit it.
    if let Some(cpus) = &settings.stages[stage].cpus {
        pin(cpus)?;
    }
    // This thread is one of the pool's: whoever enters a pool from outside waits for it to wake up, and makes it allocate
    // now and then.
    rayon::ThreadPoolBuilder::new()
        .num_threads(settings.stages[stage].threads)
        .use_current_thread()
        .build_global()
        .context("starting the threads")?;
    let shutdown = Shutdown::on_signals()?;
    let mut shell = Shell::stage(&settings.instance, stage, shutdown)?;
    shell.verify_mapping = settings.verify_mapping;
    let model = model::load_for(&settings)?;
    shell.model = Some(model.fingerprint);
    let done = match stage {
        Stage::Ingest => ingest::run(&mut shell, &settings, &model, args.start_sequence),
        Stage::Backbone => backbone::run(&mut shell, &settings, &model),
        Stage::Head => head::run(&mut shell, &model),
        Stage::Refiner => refiner::run(&mut shell, &settings, &model),
    };
    done.with_context(|| format!("stage {}", stage.name()))
}

/// Has the kernel send SIGTERM when the supervisor dies, however it dies.
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
