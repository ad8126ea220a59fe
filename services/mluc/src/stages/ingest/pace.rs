//! When the next frame enters.

use super::sender::Sender;
use crate::{control::ROLE, settings::Settings};
use anyhow::Context;
use mluc_runtime::{ClaimNote, RuntimeError, monotonic_ns, wall_clock_ns};
use std::time::Duration;

/// Frames per second of an input without stamps.
const RATE_HZ: f64 = 10.0;
/// Silence after which a frame is sent again.
const ANSWER_PATIENCE_NS: u64 = 10_000_000_000;
/// Times that a frame is sent again before it counts as lost.
const RESENDS_MAX: u32 = 2;
/// How long the last frame of a run at the sensor's pace may take.
const LAST_FRAME_NS: u64 = 5_000_000_000;
pub(super) const POLL_INTERVAL: Duration = Duration::from_millis(20);
const TAKEN_POLL_INTERVAL: Duration = Duration::from_micros(200);

/// Sends frames at the sensor's rate, whether or not the later stages keep up.
pub(crate) fn sensor(sender: &mut Sender, settings: &Settings, first: u64) -> anyhow::Result<()> {
    let mut begun_ns = monotonic_ns();
    let end_ns = end_ns(sender, settings, first)?;
    let (mut last, mut first_ns) = (None, 0);
    for sequence in first.. {
        // The file is read before its frame is due, so that reading it does not delay the frame.
        if !sender.load(sequence, end_ns)? {
            break;
        }
        let offset_ns = offset_ns(sender.loaded.scan.offset_ns, settings, sequence);
        if sequence == first {
            // A capture takes time to reach the frame that a restarted ingest begins with: the clock starts after that.
            (first_ns, begun_ns) = (offset_ns, monotonic_ns());
        }
        let mut due_ns = begun_ns + offset_ns.saturating_sub(first_ns);
        if sender.source.is_live() {
            let waited = sender.loaded.scan.arrived.map(|at| at.elapsed());
            // Suspended, the machine counts no monotonic time.
            let waited_ns = waited.unwrap_or_default().as_nanos() as u64;
            due_ns = monotonic_ns().saturating_sub(waited_ns);
        }
        if due_ns >= end_ns {
            break;
        }
        if !sleep_until(sender, due_ns)? {
            return Ok(());
        }
        sender.send(sequence, 0, due_ns)?;
        last = Some(sequence);
    }
    if let Some(last) = last {
        await_objects(sender, last, LAST_FRAME_NS)?;
    }
    Ok(())
}

/// When a frame is due after the source's first one, ns: from the stamps, or from a rate.
fn offset_ns(stamped_ns: Option<u64>, settings: &Settings, sequence: u64) -> u64 {
    match (stamped_ns, settings.rate_hz) {
        (Some(offset_ns), None) => offset_ns,
        (_, rate_hz) => (sequence as f64 * 1e9 / rate_hz.unwrap_or(RATE_HZ)) as u64,
    }
}

/// When the input's time ends, ns. Time that this stage spent before a restart counts.
fn end_ns(sender: &mut Sender, settings: &Settings, first: u64) -> anyhow::Result<u64> {
    let Some(seconds) = settings.seconds else {
        return Ok(u64::MAX);
    };
    let run = sender.shell.run().context("the run")?;
    let spent_ns = wall_clock_ns().saturating_sub(run.started_ns);
    let spent_ns = if first > 0 { spent_ns } else { 0 };
    Ok((monotonic_ns() + (seconds * 1e9) as u64).saturating_sub(spent_ns))
}

/// Sleeps until a frame is due. False: asked to end.
fn sleep_until(sender: &mut Sender, due_ns: u64) -> Result<bool, RuntimeError> {
    loop {
        // Objects are taken only so that a full queue does not look like a gap at the end.
        sender.objects.newest()?;
        let now_ns = monotonic_ns();
        if sender.shell.is_stopping() {
            return Ok(false);
        }
        if now_ns >= due_ns {
            return Ok(true);
        }
        sender.shell.tick()?;
        std::thread::sleep(Duration::from_nanos(due_ns - now_ns).min(POLL_INTERVAL));
    }
}

pub(crate) fn complete(sender: &mut Sender, settings: &Settings, first: u64) -> anyhow::Result<()> {
    let end_ns = end_ns(sender, settings, first)?;
    // With `parts` parts, one part has every `parts`-th scan.
    let parts = settings.layout.shard.map_or(1, |[_, parts]| parts);
    sender.step_ns = Some(offset_ns(None, settings, parts.into()));
    for sequence in first.. {
        let is_over = monotonic_ns() >= end_ns || sender.shell.is_stopping();
        if is_over || !sender.load(sequence, end_ns)? {
            break;
        }
        let mut is_out = false;
        for attempt in 0..=RESENDS_MAX {
            if !sender.wait_until_ready()? || !sender.wait_while_held()? {
                return Ok(());
            }
            if attempt > 0 {
                tracing::warn!(sequence, attempt, "frame sent again");
                // The scan may have been set aside since.
                sender.load(sequence, end_ns)?;
            }
            sender.send(sequence, attempt, monotonic_ns())?;
            is_out = await_objects(sender, sequence, ANSWER_PATIENCE_NS)?;
            if is_out {
                await_supervisor(sender, sequence)?;
            }
            if is_out || sender.shell.is_stopping() {
                break;
            }
        }
        if !is_out && !sender.shell.is_stopping() {
            sender.shell.health.frames_dropped += 1;
            let times = RESENDS_MAX + 1;
            tracing::error!(
                sequence,
                "frame lost: no objects came, although it was sent {times} times"
            );
        }
    }
    Ok(())
}

/// Waits until the supervisor, if there is one, has taken the objects too: its queue is short, and the next frame may come out at once.
fn await_supervisor(sender: &mut Sender, sequence: u64) -> anyhow::Result<()> {
    let deadline_ns = monotonic_ns() + ANSWER_PATIENCE_NS;
    let is_waiting = |sender: &Sender| {
        let note = ClaimNote::of_living(sender.shell.instance(), ROLE);
        note.is_some_and(|note| note.sequence.is_none_or(|taken| taken < sequence))
    };
    while is_waiting(sender) && !sender.shell.is_stopping() && monotonic_ns() < deadline_ns {
        sender.shell.tick()?;
        std::thread::sleep(TAKEN_POLL_INTERVAL);
    }
    Ok(())
}

/// Waits for the objects of a frame. False: `patience_ns` is over, a later stage was restarted, or this process was asked to end.
fn await_objects(sender: &mut Sender, sequence: u64, patience_ns: u64) -> anyhow::Result<bool> {
    let deadline_ns = monotonic_ns() + patience_ns;
    sender.watch.update()?;
    let pids = sender.pids_behind();
    loop {
        while let Some(objects) = sender.objects.oldest()? {
            let (header, wanted) = (objects.header(), sequence..sequence + 1);
            let run = sender.shell.run();
            if run.is_some_and(|run| header.checked_in(run, wanted).is_ok()) {
                return Ok(true);
            }
        }
        sender.watch.update()?;
        let mut pairs = pids.into_iter().zip(sender.pids_behind());
        let is_restarted = pairs.any(|(then, now)| then != 0 && now != 0 && then != now);
        if sender.shell.is_stopping() || monotonic_ns() >= deadline_ns || is_restarted {
            return Ok(false);
        }
        sender.shell.tick()?;
        sender.objects.wait(POLL_INTERVAL);
    }
}
