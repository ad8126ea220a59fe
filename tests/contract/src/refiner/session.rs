//! One program under test, and the ports around it.

use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use mluc_ipc_types::{Health, HealthState};
use mluc_runtime::{Instance, Shutdown};

use crate::program::Program;
use crate::refiner::answer::{check_form, check_objects};
use crate::refiner::cases::{CASES, Case};
use crate::refiner::frame::{Answer, Frame, Sent};
use crate::refiner::player::Player;
use crate::report::{Report, Verdict};

/// What the suite shall test, and how.
pub(crate) struct Options {
    /// For the report.
    pub(crate) title: String,
    /// Program and arguments.
    pub(crate) command: Vec<String>,
    /// Whether `--instance NAME` is added: ours takes no other word for it.
    pub(crate) names_instance: bool,
    /// Names of the model's classes.
    pub(crate) classes: Vec<String>,
    /// Of the model.
    pub(crate) fingerprint: u64,
    /// Its name in the description of the run.
    pub(crate) model: String,
    /// Only these cases; empty: all.
    pub(crate) cases: Vec<String>,
    /// How long an answer, or a start, may take. A program that needs longer failed.
    pub(crate) patience: Duration,
    /// Ends the suite early.
    pub(crate) shutdown: Shutdown,
}

impl Options {
    /// Program and arguments for an instance.
    pub(crate) fn command_for(&self, instance: &Instance) -> Vec<String> {
        let mut command = self.command.clone();
        if self.names_instance {
            command.extend(["--instance", instance.name()].map(str::to_string));
        }
        command
    }

    /// What the program finds in its environment: all that it needs.
    pub(crate) fn environment(&self, instance: &Instance) -> [(String, String); 1] {
        [(Instance::VARIABLE.to_string(), instance.name().to_string())]
    }
}

/// Runs the suite. A program that never became ready is not asked for more: every case would fail for the same reason.
pub(crate) fn judge(options: &Options) -> anyhow::Result<Report> {
    let mut report = Report::new(options.title.clone());
    let wanted = |case: &&Case| {
        options.cases.is_empty() || options.cases.iter().any(|name| name == case.name)
    };
    let mut session = Session::new(options, "suite")?;
    let mut cases = CASES.iter().filter(wanted);
    while let Some(case) = cases.next() {
        let begun = Instant::now();
        let result = (case.run)(&mut session);
        session.player.check_running()?;
        let (passed, what) = match result {
            Ok(seen) => (true, seen),
            Err(error) => (false, format!("{error:#}")),
        };
        if !passed {
            // The next case begins with a fresh process.
            session.stop_program();
        }
        report.add(Verdict {
            name: case.name,
            asks: case.asks,
            passed,
            what,
            ms: begun.elapsed().as_millis() as u64,
        });
        if !passed && !session.was_ready {
            report.not_run = cases.count();
            break;
        }
    }
    Ok(report)
}

/// How a program takes a frame that makes no sense.
pub(crate) enum Reaction {
    /// With objects, whose form was not looked at.
    Answered(Box<(Sent, Answer)>),
    /// With `messages_refused`; the reason it told.
    Refused(String),
}

/// Ports and program.
pub(crate) struct Session<'a> {
    pub(crate) options: &'a Options,
    program: Option<Program>,
    /// Whether a start of it ever came to a heartbeat.
    was_ready: bool,
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
        let command = self.options.command_for(&self.instance);
        let environment = self.options.environment(&self.instance);
        let since_ns = self.player.forget_heartbeats()?;
        self.program = Some(Program::start(&command, &environment)?);
        let begun = Instant::now();
        loop {
            self.check_alive("it should start")?;
            std::thread::sleep(Duration::from_millis(5));
            let run_id = self.player.run_id();
            let is_ready = |health: &Health| is_ready(health, run_id);
            if let Some(health) = self.player.health_since(since_ns, is_ready)? {
                self.was_ready = true;
                self.player.forget_answers()?;
                return Ok(health);
            }
            if begun.elapsed() > self.options.patience {
                let heard = self.player.health()?;
                bail!(
                    "no heartbeat of health/refiner with state waiting_input, running or degraded within {:?} of the \
                     start (last heard: {})",
                    self.options.patience,
                    heard.map_or("nothing".to_string(), |(health, _)| describe(&health))
                );
            }
        }
    }

    /// Starts the program unless it runs.
    pub(crate) fn ready(&mut self) -> anyhow::Result<()> {
        let runs = self
            .program
            .as_mut()
            .is_some_and(|program| program.ended().is_none());
        if !runs {
            self.start()?;
        }
        self.player.forget_answers()
    }

    pub(crate) fn check_alive(&mut self, while_what: &str) -> anyhow::Result<()> {
        self.player.check_running()?;
        let program = self.program()?;
        match program.ended() {
            None => Ok(()),
            Some(status) => {
                let words = program.last_words();
                bail!("it ended ({status}) while {while_what}; its last words: {words}")
            }
        }
    }

    /// Waits for the objects of a frame; answers to earlier ones are passed over.
    pub(crate) fn await_answer(&mut self, sent: &Sent) -> anyhow::Result<Answer> {
        let begun = Instant::now();
        let sequence = sent.header.sequence;
        loop {
            while let Some(answer) = self.player.take_answer()? {
                if answer.header.sequence == sequence {
                    return Ok(answer);
                }
            }
            self.check_alive(&format!("it should answer frame {sequence}"))?;
            if begun.elapsed() > self.options.patience {
                let heard = self.player.health()?;
                bail!(
                    "no objects of frame {sequence} within {:?} (health: {})",
                    self.options.patience,
                    heard.map_or("none".to_string(), |(health, _)| describe(&health))
                );
            }
            self.player.wait();
        }
    }

    /// Sends a frame whose detections make sense, and checks the answer.
    pub(crate) fn ask(&mut self, frame: &Frame) -> anyhow::Result<(Sent, Answer)> {
        let sent = self.player.send(frame)?;
        let answer = self.await_answer(&sent)?;
        check_form(&sent, &answer, self.options.classes.len())?;
        check_objects(&sent, &answer)?;
        Ok((sent, answer))
    }

    /// Sends a frame that makes no sense; it must be answered, or refused and counted.
    pub(crate) fn provoke(&mut self, frame: &Frame) -> anyhow::Result<Reaction> {
        // A fresh heartbeat: an older one may not yet count what was refused before.
        let heard = self.player.await_health(self.options.patience, |_| true)?;
        let before = heard.map_or(0, |health| health.messages_refused);
        let sent = self.player.send(frame)?;
        let begun = Instant::now();
        loop {
            while let Some(answer) = self.player.take_answer()? {
                if answer.header.sequence == sent.header.sequence {
                    return Ok(Reaction::Answered(Box::new((sent, answer))));
                }
            }
            self.check_alive("it should answer or refuse it")?;
            if let Some((health, _)) = self.player.health()?
                && health.messages_refused > before
            {
                return Ok(Reaction::Refused(health.reason().to_string()));
            }
            if begun.elapsed() > self.options.patience {
                bail!(
                    "neither objects nor a higher count of messages_refused within {:?}",
                    self.options.patience
                );
            }
            self.player.wait();
        }
    }
}

/// Whether it takes frames of the run.
fn is_ready(health: &Health, run_id: u64) -> bool {
    let state = health.checked().map(|(_, state)| state);
    health.run_id == run_id
        && matches!(
            state,
            Ok(HealthState::WaitingInput | HealthState::Running | HealthState::Degraded)
        )
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
