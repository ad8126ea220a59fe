//! The suite of a consumer: plays a pipeline over the same shared memory, and reads the lines that the program writes.

mod cases;
mod player;

use crate::{program::Options, suite, suite::Case, suite::Suite};
use anyhow::{Context, ensure};
use mluc_runtime::Instance;
use player::Frame;
pub(crate) use player::Player;
use serde_json::Value;
use std::time::Duration;

/// Interval at which a wait checks its condition.
const LOOK: Duration = Duration::from_millis(5);
/// Time between two frames until the first one is taken.
const PERIOD: Duration = Duration::from_millis(100);

/// The player is `None` between two pipelines.
type Session = suite::Session<Option<Player>>;

impl Suite for Option<Player> {
    const CASES: &'static [Case<Session>] = cases::CASES;
    const ASKS: &'static str = include_str!("asks.txt");

    fn new(instance: &Instance, options: &Options) -> anyhow::Result<Self> {
        Player::new(instance, options).map(Some)
    }

    fn ready(session: &mut Session) -> anyhow::Result<()> {
        if session.tested.runs() {
            return Ok(());
        }
        session.tested.start()?;
        session.first_frame()
    }
}

impl Session {
    fn player(&mut self) -> anyhow::Result<&mut Player> {
        self.player.as_mut().context("no pipeline is played")
    }

    /// Sends frames until one is taken.
    fn first_frame(&mut self) -> anyhow::Result<()> {
        let Session { tested, player } = self;
        let player = player.as_mut().context("no pipeline is played")?;
        let awaited = "line of JSON on stdout with the `sequence` of a frame";
        let before = tested.program()?.lines()?.len();
        tested.await_any(awaited, |program| {
            player.send(&player.frame())?;
            std::thread::sleep(PERIOD);
            Ok((program.lines()?.len() > before).then_some(()))
        })?;
        tested.was_ready = true;
        self.ask()
    }

    /// The lines that the program has written so far.
    fn lines(&mut self) -> anyhow::Result<Vec<Value>> {
        self.tested.program()?.lines()
    }

    /// Sends a sound frame; its line must match the frame's content.
    fn ask(&mut self) -> anyhow::Result<()> {
        let frame = self.player()?.frame();
        self.player()?.send(&frame)?;
        self.await_line(&frame)
    }

    fn await_line(&mut self, frame: &Frame) -> anyhow::Result<()> {
        let sequence = frame.header.sequence;
        let awaited = format!("line of frame {sequence}");
        let line = self.tested.await_any(&awaited, |program| {
            std::thread::sleep(LOOK);
            let mut lines = program.lines()?.into_iter();
            Ok(lines.rfind(|line| line["sequence"] == sequence))
        })?;
        let Some(objects) = line["objects"].as_array() else {
            return Ok(());
        };
        let expected = frame.published_points();
        let (wanted, found) = (expected.len(), objects.len());
        ensure!(
            wanted == found,
            "frame {sequence}: expected {wanted} published objects, found {found}"
        );
        for (points, object) in expected.iter().zip(objects) {
            let found = object["points"].as_u64();
            ensure!(
                found.is_none_or(|found| found == *points),
                "frame {sequence}: expected an object with {points} points, found {object}"
            );
        }
        Ok(())
    }
}
