//! One process of an instance.

use crate::{
    Claim, HealthWatch, Input, Instance, Membership, Message, Output, Payload, RuntimeError,
    Shutdown, StatusWatch, monotonic_ns,
};
use crate::{error::Result, health::Heartbeat, input::Wake, manager::Manager, node::IpcNode};
use crate::{mapping, mapping::Prefault, run, run::RunWatch};
use mluc_ipc_types::{
    FrameHeader, Health, HealthState, RunDescription, Stage, Text, Topic, WIRE_VERSION,
};
use std::time::{Duration, Instant};

/// Time between two checks for new segments, ns.
const TOUCH_PERIOD_NS: u64 = 100_000_000;
/// Time between two polls for the first description of a run.
const RUN_POLL: Duration = Duration::from_millis(5);
/// Poll interval of a waiting process: also the longest time until it sees a signal.
const TICK: Duration = Duration::from_millis(50);

/// A process of an instance: ports, waiting, health, and cleanup at the end. Drop the ports first.
pub struct Shell {
    // Fields drop in this order: ports, node, claim, membership.
    pub(crate) heartbeat: Option<Heartbeat>,
    run: RunWatch,
    /// Publishes the description of the run; `None` if this process does not describe it.
    run_writer: Option<(Output<RunDescription>, Claim)>,
    node: IpcNode,
    claim: Option<Claim>,
    membership: Membership,
    /// Inputs that are opened later look up each payload in `/proc/self/maps` (about 0.1 ms per message) and fail if it is not in shared memory.
    pub verify_mapping: bool,
    /// Whether pages of shared memory are touched before the first frame uses them.
    pub prefaults: bool,
    prefault: Prefault,
    touched_ns: u64,
    shutdown: Shutdown,
    /// Set if systemd started this process.
    manager: Option<Manager>,
    /// Since when the awaited message is missing, ns, and whether this was reported.
    silence: Option<(u64, bool)>,
    /// Published with every heartbeat; the program updates its counters.
    pub health: Health,
}

/// How long to wait for a process that has the role and is ending.
const LEAVING_PATIENCE: Duration = Duration::from_secs(2);

/// Joins. While a predecessor has the role, it waits outside of the instance: a predecessor that is alone there removes its files.
fn join_as(instance: &Instance, role: Option<&str>) -> Result<(Membership, Option<Claim>)> {
    let begun = Instant::now();
    loop {
        let membership = Membership::join(instance, role.unwrap_or("observer"))?;
        match role.map(|role| membership.claim(role)).transpose() {
            Err(RuntimeError::AlreadyRunning(..)) if begun.elapsed() < LEAVING_PATIENCE => (),
            claimed => return Ok((membership, claimed?)),
        }
        drop(membership);
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// The result of a wait with a timeout.
pub enum Next<T: Payload> {
    /// The newest message.
    Message(Message<T>),
    /// No message came.
    Timeout,
    /// This process was asked to end.
    Stopping,
}

impl Shell {
    /// Joins as a stage; fails when another process is that stage already.
    pub fn stage(instance: &Instance, stage: Stage, shutdown: Shutdown) -> Result<Shell> {
        let mut shell = Shell::join(instance, Some(stage.name()), true, shutdown)?;
        shell.heartbeat = Some(Heartbeat::open(&shell.node, stage)?);
        shell.follow_run()?;
        shell.beat()?;
        Ok(shell)
    }

    /// Joins as an observer: supervisor, status. Only one process may have a given `role`. An observer without a role cleans up after
    /// killed processes, which would otherwise keep their slots for ever.
    pub fn observer(instance: &Instance, role: Option<&str>, shutdown: Shutdown) -> Result<Shell> {
        Shell::join(instance, role, role.is_none(), shutdown)
    }

    fn join(instance: &Instance, role: Option<&str>, cleans: bool, end: Shutdown) -> Result<Shell> {
        let name = role.unwrap_or("observer");
        let (membership, claim) = join_as(instance, role)?;
        let node = IpcNode::join(instance, name, cleans)?;
        Ok(Shell {
            heartbeat: None,
            run: RunWatch::open(&node)?,
            run_writer: None,
            node,
            claim,
            membership,
            verify_mapping: false,
            prefaults: true,
            prefault: Prefault::default(),
            touched_ns: 0,
            shutdown: end,
            manager: role.and_then(|_| Manager::from_environment()),
            silence: None,
            health: Health {
                wire_version: WIRE_VERSION,
                pid: std::process::id(),
                ..bytemuck::Zeroable::zeroed()
            },
        })
    }

    /// Removes what killed processes left while others of the instance are alive. iceoryx2's cleaning may hang: call this in a
    /// separate process, which can be killed.
    pub fn remove_dead(instance: &Instance) -> Result<()> {
        Shell::join(instance, None, true, Shutdown::default()).map(drop)
    }

    /// Whether a killed process left ports in the instance.
    pub fn has_dead(&self) -> bool {
        self.node.has_dead()
    }

    /// Notes which frame is being worked on, so that others can find out which frame this process died of.
    pub fn note_frame(&self, sequence: Option<u64>) {
        if let Some(Err(error)) = self.claim.as_ref().map(|claim| claim.note_frame(sequence)) {
            tracing::debug!(%error, "noting the frame");
        }
    }

    /// The shared segment (its inode) that `elements` lie in; `None` when they lie elsewhere. For proofs, not for every frame.
    pub fn segment_of<T>(&self, elements: &[T]) -> Option<u64> {
        mapping::segment_of(self.instance(), elements).map(|mapping| mapping.inode)
    }

    /// Whether this process was asked to end.
    pub fn is_stopping(&self) -> bool {
        self.shutdown.is_requested()
    }

    /// The pipeline that this process belongs to.
    pub fn instance(&self) -> &Instance {
        &self.node.instance
    }

    /// Begins a new run and describes it to all readers, now and later. False: another process of the instance already describes
    /// the run ([`Shell::await_run`] waits for its description).
    pub fn begin_run(&mut self, description: &RunDescription) -> Result<bool> {
        // Drops the writer of the run that this process began before.
        self.run_writer = None;
        let claim = match self.membership.claim(run::ROLE) {
            Err(RuntimeError::AlreadyRunning(..)) => return Ok(false),
            claimed => claimed?,
        };
        let output = self.output(&Topic::RUN, 1)?;
        self.run_writer = Some((output, claim));
        self.describe_run(description)?;
        self.follow_run()?;
        Ok(true)
    }

    /// Publishes a new description of the run that this process has begun. Does nothing if another process has begun the run.
    pub fn describe_run(&mut self, description: &RunDescription) -> Result<()> {
        let mut header = FrameHeader::new(0, run::ROLE);
        header.run_id = description.run_id;
        header.model_fingerprint = description.model_fingerprint;
        if let Some((output, _)) = &mut self.run_writer {
            output.send(&header, &[*description])?;
            self.run.current = Some(*description);
        }
        Ok(())
    }

    /// Whether this process has begun the run that it takes part in.
    pub fn describes_run(&self) -> bool {
        self.run_writer.is_some()
    }

    /// The run that this process takes part in.
    pub fn run(&self) -> Option<&RunDescription> {
        self.run.current.as_ref()
    }

    /// Takes a newer description of the run; the heartbeats carry its id from now on.
    fn follow_run(&mut self) -> Result<()> {
        self.run.update()?;
        if self.health.run_id == self.run.id() {
            return Ok(());
        }
        self.health.run_id = self.run.id();
        // What ended was the last run's input.
        if self.health.state == HealthState::Stopping as u32 {
            self.health.state = HealthState::Starting as u32;
        }
        self.beat()
    }

    /// Waits until a run is known, and sends heartbeats. False: the timeout has passed, or this process was asked to end.
    pub fn await_run(&mut self, timeout: Duration) -> Result<bool> {
        let begun_ns = monotonic_ns();
        while self.run().is_none() {
            self.tick()?;
            if self.run().is_some() {
                self.silence = None;
                break;
            }
            let now_ns = monotonic_ns();
            if self.is_stopping() || Duration::from_nanos(now_ns - begun_ns) > timeout {
                return Ok(false);
            }
            // Counted across calls, because one call may be shorter than the silence.
            let (since_ns, is_said) = self.silence.get_or_insert((begun_ns, false));
            let is_long = Duration::from_nanos(now_ns - *since_ns) > Topic::SILENCE_MAX;
            if is_long && !std::mem::replace(is_said, true) {
                let name = self.instance().name();
                let reason = format!(
                    "waiting for the run: no pipeline and no ingest of this user is running as '{name}'"
                );
                tracing::info!("{reason}");
                self.state(HealthState::WaitingInput, &reason)?;
            }
            std::thread::sleep(RUN_POLL);
        }
        Ok(true)
    }

    /// The producer's end of a topic, for messages of up to `elements_max` elements.
    pub fn output<T: Payload>(&mut self, topic: &Topic, elements_max: usize) -> Result<Output<T>> {
        let elements_max = elements_max.min(topic.elements_max);
        let output = Output::open(&self.node, topic, topic.name, elements_max)?;
        self.touch()?;
        Ok(output)
    }

    /// The consumer's end of a topic that this process waits for.
    pub fn input<T: Payload>(&self, topic: &Topic) -> Result<Input<T>> {
        self.open_input(topic, true)
    }

    /// The consumer's end of a topic that this process polls: the producer does not end its waits.
    pub fn side_input<T: Payload>(&self, topic: &Topic) -> Result<Input<T>> {
        self.open_input(topic, false)
    }

    pub(crate) fn open_input<T: Payload>(&self, topic: &Topic, wakes: bool) -> Result<Input<T>> {
        let mut input = Input::open(&self.node, topic, topic.name, wakes)?;
        input.verify_mapping = self.verify_mapping;
        Ok(input)
    }

    /// All stages' heartbeats.
    pub fn health_watch(&self) -> Result<HealthWatch> {
        HealthWatch::open(&self.node)
    }

    /// The pipeline's status.
    pub fn status_watch(&self) -> Result<StatusWatch> {
        StatusWatch::open(&self.node)
    }

    /// Waits for the newest message, at most `timeout`, and sends heartbeats. After [`Topic::SILENCE_MAX`], counted across calls,
    /// it reports what it waits for.
    ///
    /// `on_tick` gets the run, and whether there is time because no message has come. If it returns a listener, the wait uses that one.
    pub(crate) fn next_within<T: Payload>(
        &mut self,
        input: &mut Input<T>,
        mut on_tick: impl FnMut(Option<&RunDescription>, bool) -> Result<Option<Wake>>,
        timeout: Duration,
    ) -> Result<Next<T>> {
        let begun_ns = monotonic_ns();
        self.silence.get_or_insert((begun_ns, false));
        loop {
            if self.is_stopping() {
                return Ok(Next::Stopping);
            }
            self.follow_run()?;
            // The wake-up of a message that was already taken ends the wait below early, once. Clearing it here would cost two
            // system calls between a wake-up and its message.
            let message = input.newest()?;
            let wake = on_tick(self.run(), message.is_none())?;
            if let Some(message) = message {
                if let Some((since_ns, true)) = self.silence.take() {
                    let waited_ms = (monotonic_ns() - since_ns) / 1_000_000;
                    tracing::info!(waited_ms, "{} arrive", input.name());
                }
                return Ok(Next::Message(message));
            }
            self.say_silence(input)?;
            // Only while there is nothing to do: reading this process's memory map takes 0.1 ms. With few cores, the consumer of
            // a message that was just sent may have to wait that long.
            if monotonic_ns() - self.touched_ns >= TOUCH_PERIOD_NS {
                self.touch()?;
            }
            self.tick()?;
            let left = timeout.saturating_sub(Duration::from_nanos(monotonic_ns() - begun_ns));
            if left.is_zero() {
                return Ok(Next::Timeout);
            }
            match wake {
                Some(wake) => wake.wait(left.min(TICK)),
                None => input.wait(left.min(TICK)),
            }
        }
    }

    /// Reports once what is missing.
    fn say_silence<T: Payload>(&mut self, input: &Input<T>) -> Result<()> {
        let Some((since_ns, is_said @ false)) = &mut self.silence else {
            return Ok(());
        };
        if Duration::from_nanos(monotonic_ns() - *since_ns) <= Topic::SILENCE_MAX {
            return Ok(());
        }
        *is_said = true;
        let what = match input.producers() {
            0 => "no producer is running",
            _ => "their producer is silent",
        };
        let reason = format!("waiting for {}: {what}", input.name());
        tracing::info!("{reason}");
        self.state(HealthState::WaitingInput, &reason)
    }

    /// Refuses a message that breaks the contract or belongs to another model: it is counted and reported, and the next one is taken.
    pub fn refuse(&mut self, why: &str) -> Result<()> {
        self.health.messages_refused += 1;
        tracing::warn!("message refused: {why}");
        self.state(HealthState::Degraded, why)
    }

    /// Sets the state of this stage and its reason; a change is published at once.
    pub fn state(&mut self, state: HealthState, reason: &str) -> Result<()> {
        let said = (state as u32, Text::pack(reason));
        if (self.health.state, self.health.reason) == said {
            return Ok(());
        }
        (self.health.state, self.health.reason) = said;
        if [HealthState::WaitingInput, HealthState::Running].contains(&state) {
            self.say_ready();
        }
        self.beat()
    }

    /// Reports to systemd that this process is ready.
    pub fn say_ready(&mut self) {
        if let Some(manager) = &mut self.manager {
            manager.ready();
        }
    }

    /// Periodic work: checks for a new run, sends the description to late readers, and sends a heartbeat when it is due.
    pub fn tick(&mut self) -> Result<()> {
        if let Some(manager) = &mut self.manager {
            manager.alive();
        }
        crate::tell_repeats(false);
        self.follow_run()?;
        if let Some((output, _)) = &self.run_writer {
            output.reach_late_readers()?;
        }
        let heartbeat = self.heartbeat.as_mut();
        heartbeat.map_or(Ok(()), |heartbeat| heartbeat.keep_up(&self.health))
    }

    /// Sends a heartbeat now.
    pub fn beat(&mut self) -> Result<()> {
        let heartbeat = self.heartbeat.as_mut();
        heartbeat.map_or(Ok(()), |heartbeat| heartbeat.publish(&self.health))
    }

    /// Touches segments that other processes made, and sends heartbeats meanwhile.
    fn touch(&mut self) -> Result<()> {
        self.touched_ns = monotonic_ns();
        if self.prefaults {
            let (heartbeat, health) = (&mut self.heartbeat, &self.health);
            let keep_up = || heartbeat.as_mut().map_or(Ok(()), |h| h.keep_up(health));
            self.prefault.touch(&self.node.instance, keep_up)?;
        }
        Ok(())
    }
}
