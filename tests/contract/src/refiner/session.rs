//! One program under test, and the ports that are connected to it.

use crate::refiner::answer::{check_form, check_objects};
use crate::refiner::player::{Answer, Frame, Player};
use crate::suite;
use anyhow::{Context, anyhow, bail};
use mluc_ipc_types::{Health, Stage};
use mluc_runtime::monotonic_ns;
use std::time::Duration;

/// Interval at which a wait checks its condition.
const LOOK: Duration = Duration::from_millis(20);

/// The reaction to a frame that makes no sense: objects, whose form is not checked yet, or a count in `messages_refused` with a reason.
pub(crate) type Reaction = Result<Box<Answer>, String>;

pub(crate) type Session = suite::Session<Player>;

impl Session {
    /// Starts the program anew and waits until its health says that it takes frames.
    pub(crate) fn start(&mut self) -> anyhow::Result<Health> {
        self.tested.stop();
        let since_ns = self.forget_heartbeats()?;
        self.tested.start()?;
        let what = "heartbeat of health/refiner with state waiting_input, running or degraded";
        let health = self.await_any(what, |player| {
            let heard = player.health_since(since_ns)?;
            Ok(heard.filter(|_| player.health.is_ready(Stage::Refiner)))
        })?;
        self.tested.was_ready = true;
        self.player.forget_answers()?;
        Ok(health)
    }

    /// What `look` finds within the patience while the program lives.
    pub(crate) fn await_any<T>(
        &mut self,
        awaited: &str,
        mut look: impl FnMut(&mut Player) -> anyhow::Result<Option<T>>,
    ) -> anyhow::Result<T> {
        let Session { tested, player } = self;
        let found = tested.await_any(awaited, |_| {
            let found = look(player)?;
            if found.is_none() {
                player.objects.wait(LOOK);
            }
            Ok(found)
        });
        let heard = player.health_since(0)?.map_or("none".to_string(), |health| describe(&health));
        found.map_err(|error| anyhow!("{error:#} (health: {heard})"))
    }

    /// Takes the heartbeats that were sent before now; returns the time after which a heartbeat is fresh.
    fn forget_heartbeats(&mut self) -> anyhow::Result<u64> {
        self.player.heard_ns()?;
        Ok(monotonic_ns())
    }

    /// Waits for a new heartbeat that fulfils `wanted`; `what` names it.
    pub(crate) fn await_health(
        &mut self,
        what: &str,
        wanted: impl Fn(&Health) -> bool,
    ) -> anyhow::Result<Health> {
        let since_ns = self.forget_heartbeats()?;
        let heard = |player: &mut Player| Ok(player.health_since(since_ns)?.filter(&wanted));
        self.await_any(what, heard)
    }

    /// The current health: an older heartbeat may not yet count what has already happened.
    pub(crate) fn fresh_health(&mut self) -> anyhow::Result<Health> {
        self.await_health("heartbeat", |_| true)
    }

    pub(crate) fn exchange(&mut self, frame: &mut Frame) -> anyhow::Result<Answer> {
        self.player.send(frame)?;
        let sequence = frame.header.sequence;
        let awaited = format!("objects of frame {sequence}");
        self.await_any(&awaited, |player| player.take_answer_to(sequence))
    }

    /// Sends a frame whose detections make sense, and checks the answer.
    pub(crate) fn ask(&mut self, frame: &mut Frame) -> anyhow::Result<Answer> {
        let answer = self.exchange(frame)?;
        self.check_form(frame, &answer)?;
        check_objects(frame, &answer)?;
        Ok(answer)
    }

    /// Sends the next frame of the usual scene, and checks the answer.
    pub(crate) fn ask_usual(&mut self) -> anyhow::Result<(Frame, Answer)> {
        let mut frame = self.player.usual();
        let answer = self.ask(&mut frame)?;
        Ok((frame, answer))
    }

    /// Like `ask_usual`, after something else was sent; an error names it.
    pub(crate) fn ask_after(&mut self, what: &str) -> anyhow::Result<()> {
        self.ask_usual().with_context(|| format!("the sound frame after: {what}"))?;
        Ok(())
    }

    pub(crate) fn check_form(&self, frame: &Frame, answer: &Answer) -> anyhow::Result<()> {
        let classes = self.tested.options.run.classes_count as usize;
        check_form(frame, answer, classes)
    }

    /// Sends a frame that makes no sense; it must be answered, or refused and counted.
    pub(crate) fn provoke(&mut self, what: &str, frame: &mut Frame) -> anyhow::Result<Reaction> {
        let before = self.fresh_health()?.messages_refused;
        self.player.send(frame)?;
        let sequence = frame.header.sequence;
        let reaction = self.await_any("objects or count of messages_refused", |player| {
            if let Some(answer) = player.take_answer_to(sequence)? {
                return Ok(Some(Ok(Box::new(answer))));
            }
            let heard = player.health_since(0)?;
            let refused = heard.filter(|health| health.messages_refused > before);
            Ok(refused.map(|health| Err(health.reason().to_string())))
        });
        reaction.with_context(|| what.to_string())
    }

    /// Sends a frame that must be refused, after which the next sound one must be answered; returns the reported reason.
    pub(crate) fn must_refuse(&mut self, what: &str, mut frame: Frame) -> anyhow::Result<String> {
        let Err(reason) = self.provoke(what, &mut frame)? else {
            bail!("{what}: answered, it should be refused");
        };
        self.ask_after(what)?;
        Ok(reason)
    }
}

pub(crate) fn describe(health: &Health) -> String {
    let state = health.checked().map_or("?", |(_, state)| state.name());
    format!(
        "{state} '{}', {} in, {} out, {} dropped, {} refused",
        health.reason(),
        health.frames_in,
        health.frames_out,
        health.frames_dropped,
        health.messages_refused
    )
}
