//! `mluc replay`: runs the pipeline on a recording of `mluc record` and compares its objects with the recorded ones.

use crate::settings::{Pace, Settings, StageSettings};
use crate::supervisor::{Left, LineWriter, Sink, run};
use crate::{EXIT_FAILURE, UsageError, model};
use crate::{cli::PipelineArgs, external::own_program, stages::played, terminal::print_err};
use anyhow::Context;
use mluc_gateway::{lines::line, ros2::line_topic};
use mluc_ipc_types::{Flags, Stage};
use mluc_runtime::{Shutdown, log_to_stderr};
use mluc_sources::{Recorded, place};
use serde_json::{Value, json};
use std::{path::Path, process::ExitCode};

/// Every recorded scan goes through the pipeline. Exit code 1: objects differ, a frame was lost, or there was no frame to compare.
pub(crate) fn replay(mut args: PipelineArgs, from: Option<Stage>) -> anyhow::Result<ExitCode> {
    log_to_stderr("replay", "warn");
    let shutdown = Shutdown::on_signals()?;
    let input = args.input.clone();
    let input = input.ok_or(UsageError("expected --input RUN.mcap, found none".into()))?;
    args.pace = Some(Pace::Complete);
    // Consumers of a running pipeline must not take what it replays for live.
    let own = || format!("replay-{}", std::process::id());
    args.instance.get_or_insert_with(own);
    let mut settings = Settings::resolve(args.clone())?;
    settings.repeat = false;
    let shard = settings.layout.shard;
    if let Some(from) = from {
        play(&mut settings, &input, from)?;
    }
    let mut compared = Compared {
        recorded: Recorded::open(&input, line_topic().name, "mluc record")?,
        has_played: from.is_some(),
        shard,
        same: 0,
        other: 0,
        degraded: 0,
        without: 0,
        models: None,
    };
    let (outcome, dropped) = run(args, settings, shutdown, &mut compared)?;
    let (same, other) = (compared.same, compared.other);
    let (degraded, without) = (compared.degraded, compared.without);
    print_err(format_args!(
        "frames: {same} with the recorded objects, {other} with others, {degraded} recorded with a part of the work left out and \
         {without} of which not all was recorded (not compared), {} lost",
        outcome.frames_lost()
    ));
    if let Some([recorded, found]) = &compared.models {
        print_err(format_args!(
            "recorded with model {recorded}, replayed with {found}: name the same with --model"
        ));
    }
    dropped?;
    let is_same = same > 0 && other == 0 && outcome.frames_lost() == 0;
    Ok(ExitCode::from(if is_same { 0 } else { EXIT_FAILURE }))
}

/// Makes the stages before `from` publish their recorded messages.
fn play(settings: &mut Settings, input: &Path, from: Stage) -> anyhow::Result<()> {
    let mut recorded = played::open(input, Stage::ALL[from as usize - 1])?;
    if let Some(message) = recorded.of(0)? {
        let fingerprint = model::load_for(settings)?.fingerprint;
        played::parse::<u8>(&message, fingerprint).context("name the same model with --model")?;
    }
    let program = own_program();
    let program = program.to_string_lossy();
    let stage = |stage: Stage| StageSettings {
        command: Some(
            [&*program, "stage", stage.name(), "--played-to", from.name()]
                .map(str::to_string)
                .into(),
        ),
        ..StageSettings::default()
    };
    settings.stages.backbone = stage(Stage::Backbone);
    if from == Stage::Refiner {
        settings.stages.head = stage(Stage::Head);
    }
    Ok(())
}

struct Compared {
    recorded: Recorded,
    /// Whether stages publish recorded messages; a frame without a recorded message is flagged `degraded`.
    has_played: bool,
    shard: Option<[u32; 2]>,
    same: u64,
    other: u64,
    degraded: u64,
    without: u64,
    /// The model of the recording and the model of this run, if they differ.
    models: Option<[String; 2]>,
}

impl Sink for Compared {
    fn take(&mut self, left: Left<'_>, writer: &mut LineWriter) -> anyhow::Result<bool> {
        let is_missing = self.has_played && Flags(left.header.flags).contains(Flags::DEGRADED);
        let scan = place(self.shard, left.header.sequence);
        let message = self.recorded.of(scan)?;
        let Some(message) = message.filter(|_| !is_missing) else {
            self.without += 1;
            return Ok(true);
        };
        let about = || format!("recorded line of scan {scan}");
        // A string in CDR: its header, its length including the terminating byte, the text.
        let text = message.get(8..message.len().saturating_sub(1));
        let recorded: Value = serde_json::from_slice(text.unwrap_or(&[])).with_context(about)?;
        // Converted through text, so that numbers are rounded like the recorded ones.
        let found =
            serde_json::to_string(&line(left.header, left.objects, left.classes, left.status))?;
        let found: Value = serde_json::from_str(&found)?;
        let [own, others] = [&recorded, &found].map(|line| line["model"].as_str().unwrap_or("?"));
        if own != others {
            self.models = Some([own, others].map(str::to_string));
        }
        let flags = recorded["flags"].as_array().into_iter().flatten();
        let mut lists = ["objects", "suppressed"].iter();
        if flags.into_iter().any(|flag| flag == "degraded") {
            self.degraded += 1;
        } else if lists.all(|key| recorded[key] == found[key]) {
            self.same += 1;
        } else {
            self.other += 1;
            let of = |line: &Value| json!({"objects": line["objects"], "suppressed": line["suppressed"]});
            let told = json!({"scan": scan, "recorded": of(&recorded), "found": of(&found)});
            return writer.write(&told);
        }
        Ok(true)
    }
}
