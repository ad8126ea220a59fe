//! The suite of a source: plays the supervisor and the later stages over the same shared memory, and checks the scans.

mod cases;
mod player;

use crate::{program::Options, suite, suite::Case, suite::Suite};
use anyhow::{Context, Result, ensure};
use mluc_ipc_types::{Health, HealthState, Stage};
use mluc_runtime::Instance;
pub(crate) use player::Player;
use player::Scan;

type Session = suite::Session<Player>;

impl Suite for Player {
    const CASES: &'static [Case<Session>] = cases::CASES;
    const ASKS: &'static str = include_str!("asks.txt");

    fn new(instance: &Instance, options: &Options) -> Result<Player> {
        Player::new(instance, options)
    }

    /// Starts a new process in a new run that has sent nothing yet: inputs end.
    fn ready(session: &mut Session) -> Result<()> {
        session.tested.stop();
        session.player.begin_run()?;
        session.player.has_stages = true;
        session.start()
    }
}

impl Session {
    fn start(&mut self) -> Result<()> {
        self.tested.start()?;
        let is_heard = |health: &Health| health.state <= HealthState::Degraded as u32;
        self.await_health("heartbeat of health/ingest in the run", is_heard)?;
        self.tested.was_ready = true;
        Ok(())
    }

    /// Waits for a heartbeat of the run that fulfils `wanted`; `what` names it.
    fn await_health(&mut self, what: &str, wanted: impl Fn(&Health) -> bool) -> Result<Health> {
        let Session { tested, player } = self;
        tested.await_any(what, |_| {
            player.tick()?;
            let health = player.health.of(Stage::Ingest).copied();
            Ok(health.filter(|health| health.run_id == player.run.run_id && wanted(health)))
        })
    }

    fn next(&mut self) -> Result<Scan> {
        let Session { tested, player } = self;
        tested.await_any("scan", |_| {
            player.tick()?;
            player.take()
        })
    }

    /// The next scan, after a check of this scan alone.
    fn checked(&mut self, sequence: u64) -> Result<Scan> {
        let scan = self.next()?;
        let about = || format!("scan {}, awaited {sequence}", scan.header.sequence);
        scan.check(&self.player.run, sequence).with_context(about)?;
        Ok(scan)
    }

    /// Checks the next `count` scans from `first` on; returns the last one.
    fn checked_many(&mut self, first: u64, count: u64) -> Result<Scan> {
        let mut last = self.checked(first)?;
        for sequence in first + 1..first + count {
            let scan = self.checked(sequence)?;
            let [before, after] = [&last, &scan].map(|scan| scan.header.sensor_stamp_ns);
            ensure!(
                before < after,
                "sensor_stamp_ns of scan {sequence}: expected more than {before}, found {after}"
            );
            last = scan;
        }
        Ok(last)
    }
}
