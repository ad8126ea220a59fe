//! One program under test, and the ports around it.

use std::time::Instant;

use anyhow::{Context, bail};
use mluc_ipc_types::Health;
use mluc_runtime::{Instance, monotonic_ns};

use crate::program::{Options, Program};
use crate::refiner::answer::{check_form, check_objects};
use crate::refiner::player::{Answer, Frame, Player};

/// How a program takes a frame that makes no sense.
pub(crate) enum Reaction {
    /// With objects, whose form was not looked at.
    Answered(Box<Answer>),
    /// With `messages_refused`; the reason it told.
    Refused(String),
}

/// Ports and program.
pub(crate) struct Session<'a> {
    pub(crate) options: &'a Options,
    program: Option<Program>,
    /// Whether a start of it ever came to a heartbeat.
    pub(crate) was_ready: bool,
    pub(crate) player: Player,
    pub(crate) instance: Instance,
}

impl Session<'_> {
    /// `label`: part of the instance's name.
    pub(crate) fn new<'a>(options: &'a Options, label: &str) -> anyhow::Result<Session<'a>> {
        let instance = Instance::new(&format!("{label}-{}", std::process::id()))?;
        Ok(Session {
            player: Player::new(&instance, options)?,
            program: None,
            was_ready: false,
            options,
            instance,
        })
    }

    /// The running program.
    pub(crate) fn program(&mut self) -> anyhow::Result<&mut Program> {
        self.program.as_mut().context("the program does not run")
    }

    pub(crate) fn stop_program(&mut self) {
        self.program = None;
    }

    /// Starts the program anew and waits until its health says that it takes frames.
    pub(crate) fn start(&mut self) -> anyhow::Result<Health> {
        self.program = None;
        let since_ns = self.forget_heartbeats()?;
        self.program = Some(Program::start(&self.options.command, &self.instance)?);
        let what = "heartbeat of health/refiner with state waiting_input, running or degraded";
        let health = self.await_any(what, |player| {
            let heard = player.health_since(since_ns)?;
            Ok(heard.filter(|_| player.is_ready()))
        })?;
        self.was_ready = true;
        self.player.forget_answers()?;
        Ok(health)
    }

    /// Starts the program unless it runs.
    pub(crate) fn ready(&mut self) -> anyhow::Result<()> {
        let program = self.program.as_mut();
        if program.is_none_or(|program| program.ended().is_some()) {
            self.start()?;
        }
        self.player.forget_answers()
    }

    pub(crate) fn check_alive(&mut self, awaited: &str) -> anyhow::Result<()> {
        self.player.check_running()?;
        let program = self.program()?;
        if let Some(status) = program.ended() {
            let words = program.last_words()?;
            bail!("it ended ({status}), awaited: {awaited}; its last words: {words}");
        }
        Ok(())
    }

    /// What `look` finds within the patience, while the program lives.
    pub(crate) fn await_any<T>(
        &mut self,
        awaited: &str,
        mut look: impl FnMut(&mut Player) -> anyhow::Result<Option<T>>,
    ) -> anyhow::Result<T> {
        let begun = Instant::now();
        loop {
            if let Some(found) = look(&mut self.player)? {
                return Ok(found);
            }
            self.check_alive(awaited)?;
            let patience = self.options.patience;
            if begun.elapsed() > patience {
                let heard = self.player.health_since(0)?;
                let heard = heard.map_or("none".to_string(), |health| describe(&health));
                bail!("no {awaited} within {patience:?} (health: {heard})");
            }
            self.player.wait();
        }
    }

    /// Takes the heartbeats that were sent before now; gives the time after which one is fresh.
    fn forget_heartbeats(&mut self) -> anyhow::Result<u64> {
        self.player.heard_ns()?;
        Ok(monotonic_ns())
    }

    /// Waits for a heartbeat from now on that fulfils `wanted`; `what` names it.
    pub(crate) fn await_health(
        &mut self,
        what: &str,
        wanted: impl Fn(&Health) -> bool,
    ) -> anyhow::Result<Health> {
        let since_ns = self.forget_heartbeats()?;
        self.await_any(what, |player| {
            Ok(player.health_since(since_ns)?.filter(&wanted))
        })
    }

    /// What its health says now: an older heartbeat may not yet count what happened before.
    pub(crate) fn fresh_health(&mut self) -> anyhow::Result<Health> {
        self.await_health("heartbeat", |_| true)
    }

    /// Waits for the objects of a frame.
    fn await_answer(&mut self, frame: &Frame) -> anyhow::Result<Answer> {
        let sequence = frame.header.sequence;
        let awaited = format!("objects of frame {sequence}");
        self.await_any(&awaited, |player| player.take_answer_to(sequence))
    }

    /// Sends a frame and waits for its objects.
    pub(crate) fn exchange(&mut self, frame: &mut Frame) -> anyhow::Result<Answer> {
        self.player.send(frame)?;
        self.await_answer(frame)
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

    /// The same after something else was sent, which an error tells.
    pub(crate) fn ask_after(&mut self, what: &str) -> anyhow::Result<()> {
        let asked = self.ask_usual();
        asked.with_context(|| format!("the sound frame after: {what}"))?;
        Ok(())
    }

    /// Checks what holds of every answer.
    pub(crate) fn check_form(&self, frame: &Frame, answer: &Answer) -> anyhow::Result<()> {
        let classes = self.options.run.classes_count as usize;
        check_form(frame, answer, classes)
    }

    /// Sends a frame that makes no sense; it must be answered, or refused and counted.
    pub(crate) fn provoke(&mut self, what: &str, frame: &mut Frame) -> anyhow::Result<Reaction> {
        let before = self.fresh_health()?.messages_refused;
        self.player.send(frame)?;
        let sequence = frame.header.sequence;
        let reaction = self.await_any("objects or count of messages_refused", |player| {
            if let Some(answer) = player.take_answer_to(sequence)? {
                return Ok(Some(Reaction::Answered(Box::new(answer))));
            }
            let heard = player.health_since(0)?;
            let refused = heard.filter(|health| health.messages_refused > before);
            Ok(refused.map(|health| Reaction::Refused(health.reason().to_string())))
        });
        reaction.with_context(|| what.to_string())
    }

    /// A frame that must be refused, after which the next sound one is answered; gives the reason that was told.
    pub(crate) fn must_refuse(&mut self, what: &str, mut frame: Frame) -> anyhow::Result<String> {
        let Reaction::Refused(reason) = self.provoke(what, &mut frame)? else {
            bail!("{what}: answered, it should be refused");
        };
        self.ask_after(what)?;
        Ok(reason)
    }
}

/// A heartbeat in words.
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
