//! One program under test, and the ports around it.

use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use mluc_ipc_types::{Health, HealthState};
use mluc_runtime::{Instance, Shutdown, model_environment};

use crate::answer::{check_form, check_objects};
use crate::cases::{CASES, Case};
use crate::frame::{Answer, Frame, Sent};
use crate::player::Player;
use crate::program::Program;
use crate::report::{Report, Verdict};

/// The program's command for an instance of this name.
pub type CommandOf = Box<dyn Fn(&str) -> Vec<String>>;

/// What the suite shall test, and how.
pub struct Options {
    /// For the report.
    pub title: String,
    /// Program and arguments.
    pub command: CommandOf,
    /// Names of the model's classes.
    pub classes: Vec<String>,
    /// Of the model.
    pub fingerprint: u64,
    /// What `MLUC_MODEL` shall hold.
    pub model: String,
    /// Only these cases; empty: all.
    pub cases: Vec<String>,
    /// How long an answer, or a start, may take. A program that needs longer failed.
    pub patience: Duration,
    /// Ends the suite early.
    pub shutdown: Shutdown,
}

impl Options {
    /// What the program finds in its environment, as the supervisor sets it.
    pub(crate) fn environment(&self, instance: &Instance) -> Vec<(String, String)> {
        let stage = [
            ("MLUC_STAGE", "refiner".to_string()),
            ("MLUC_MODEL", self.model.clone()),
        ];
        let model = model_environment(&self.classes, self.fingerprint);
        instance
            .environment()
            .into_iter()
            .chain(stage)
            .chain(model)
            .map(|(key, value)| (key.to_string(), value))
            .collect()
    }
}

/// Runs the suite.
pub fn run(options: &Options) -> anyhow::Result<Report> {
    let mut report = Report::new(options.title.clone());
    let wanted = |case: &&Case| {
        options.cases.is_empty() || options.cases.iter().any(|name| name == case.name)
    };
    let mut session = Session::new(options)?;
    for case in CASES.iter().filter(wanted) {
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
    pub(crate) player: Player,
    pub(crate) instance: Instance,
}

impl Session<'_> {
    fn new(options: &Options) -> anyhow::Result<Session<'_>> {
        let instance = Instance::new(&format!("suite-{}", std::process::id()))?;
        Ok(Session {
            player: Player::new(&instance, options.fingerprint, options.shutdown.clone())?,
            program: None,
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
        let command = (self.options.command)(self.instance.name());
        let environment = self.options.environment(&self.instance);
        let since_ns = self.player.forget_heartbeats()?;
        self.program = Some(Program::start(&command, &environment)?);
        let begun = Instant::now();
        loop {
            self.check_alive("it should start")?;
            std::thread::sleep(Duration::from_millis(5));
            if let Some(health) = self.player.health_since(since_ns, is_ready)? {
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

fn is_ready(health: &Health) -> bool {
    let state = health.checked().map(|(_, state)| state);
    matches!(
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
