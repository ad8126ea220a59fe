//! `mluc up`: the pipeline on scans, JSON lines on stdout.

use crate::supervisor::{Left, LineWriter, Outcome, Sink, hops, run};
use crate::{
    EXIT_FAILURE, cli::PipelineArgs, piped::Piped, settings::Settings, terminal::print_err,
};
use mluc_gateway::lines::{line, status_line};
use mluc_ipc_types::{Flags, FrameHeader, Status};
use mluc_runtime::{Shutdown, log_to_stderr};
use std::{collections::BTreeMap, process::ExitCode};

pub(crate) fn up(mut args: PipelineArgs) -> anyhow::Result<ExitCode> {
    log_to_stderr("up", "info");
    let _piped = Piped::take(&mut args.input)?;
    let shutdown = Shutdown::on_signals()?;
    let settings = Settings::resolve(args.clone())?;
    let mut lines = Lines { has_status: settings.status_lines, summary: Summary::default() };
    let (outcome, dropped) = run(args, settings, shutdown, &mut lines)?;
    print_err(outcome.latencies.table().trim_end());
    print_err(hops(&outcome.status).trim_end());
    let (frames_in, frames_out) = (outcome.frames_in, outcome.frames_out);
    let (lost, restarts) = (outcome.frames_lost(), outcome.restarts);
    let under_way = match frames_in.saturating_sub(frames_out + lost) {
        0 => String::new(),
        count => format!(", {count} under way at the end"),
    };
    print_err(format_args!(
        "frames: {frames_in} in, {frames_out} out, {lost} lost{under_way}; stages restarted: {restarts}"
    ));
    if !outcome.set_aside.is_empty() {
        let (count, names) = (outcome.set_aside.len(), outcome.set_aside.join(", "));
        print_err(format_args!("scans set aside, because stages died of them: {count} ({names})"));
    }
    let dropped = dropped?;
    if dropped > 0 {
        let why = "the reader of stdout was too slow, or its disk is full";
        print_err(format_args!("{dropped} lines dropped: {why}"));
    }
    Ok(lines.summary.exit_code(&outcome))
}

struct Lines {
    has_status: bool,
    summary: Summary,
}

impl Sink for Lines {
    fn take(&mut self, left: Left<'_>, writer: &mut LineWriter) -> anyhow::Result<bool> {
        self.summary.record(left.header);
        let line = line(left.header, left.objects, left.classes, left.status);
        writer.write(&line)
    }

    fn tell(&mut self, status: &Status, writer: &mut LineWriter) -> anyhow::Result<bool> {
        if !self.has_status {
            return Ok(true);
        }
        writer.write(&status_line(status))
    }
}

/// Counts of the flags of all frames, of the frames, and of the usable ones among them.
#[derive(Default)]
pub(super) struct Summary {
    flags: BTreeMap<&'static str, u64>,
    frames: u64,
    usable: u64,
}

impl Summary {
    pub(super) fn record(&mut self, header: &FrameHeader) {
        self.frames += 1;
        self.usable += u64::from(header.is_usable());
        for name in Flags(header.flags).names() {
            *self.flags.entry(name).or_default() += 1;
        }
    }

    /// Prints the flags; a run without a usable frame has failed.
    pub(super) fn exit_code(&self, outcome: &Outcome) -> ExitCode {
        let word = |(name, count)| format!("{name} {count}");
        let words: Vec<_> = self.flags.iter().map(word).collect();
        if !words.is_empty() {
            print_err(format_args!("frames with flags: {}", words.join(", ")));
        }
        let why = if self.frames > 0 && self.usable == 0 {
            "5 % of the points of each or fewer, or fewer than 50, are finite and in the model's range; are the files scans?"
        } else if self.frames == 0 && !outcome.is_interrupted {
            ["the input gave no scan", "none came out"][usize::from(outcome.frames_in > 0)]
        } else {
            return outcome.exit_code();
        };
        print_err(format_args!("no frame was usable: {why}"));
        ExitCode::from([EXIT_FAILURE, 0][usize::from(outcome.is_interrupted)])
    }
}
