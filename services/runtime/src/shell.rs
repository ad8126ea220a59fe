//! One process of an instance.

use std::fmt::Debug;
use std::time::Duration;

use bytemuck::Pod;
use iceoryx2::node::Node;
use iceoryx2::prelude::ZeroCopySend;
use mluc_ipc_types::{ContractError, HealthState, RunDescription, Stage, Topic};

use crate::health::Heartbeat;
use crate::input::InputOptions;
use crate::mapping::{self, Prefault};
use crate::node::{self, Cleaning};
use crate::run::{self, RunWatch, RunWriter};
use crate::{
    Claim, Counters, HealthWatch, Input, Instance, Ipc, Membership, Message, Output, RuntimeError,
    Shutdown, monotonic_ns,
};

/// How a process joins.
#[derive(Clone, Debug)]
pub struct ShellOptions {
    /// Which pipeline.
    pub instance: Instance,
    /// Looks up each payload in `/proc/self/maps` (about 0.1 ms a message) and fails when it is no shared memory.
    pub verify_mapping: bool,
    /// Touches shared memory before the first frame does.
    pub prefault: bool,
}

impl ShellOptions {
    /// Without the check, with prefault.
    pub fn new(instance: Instance) -> ShellOptions {
        ShellOptions {
            instance,
            verify_mapping: false,
            prefault: true,
        }
    }
}

/// A process of an instance: ports, waiting, health, and leaving without a trace. Drop the ports first.
pub struct Shell {
    // Fields drop in this order: ports, node, claim, membership.
    heartbeat: Option<Heartbeat>,
    run: RunWatch,
    run_writer: Option<RunWriter>,
    /// Fingerprint of this process's model, if it has one.
    model: Option<u64>,
    node: Node<Ipc>,
    _claim: Option<Claim>,
    membership: Membership,
    options: ShellOptions,
    prefault: Prefault,
    touched_ns: u64,
    shutdown: Shutdown,
    /// Since the last message that was waited for.
    silence: Option<Silence>,
    /// Published with every heartbeat.
    pub counters: Counters,
}

/// What a wait with a timeout ends with.
pub enum Next<T: Pod + Debug + ZeroCopySend> {
    /// The newest message.
    Message(Message<T>),
    /// None came.
    Timeout,
    /// This process was asked to end.
    Stopping,
}

#[derive(Clone, Copy, Debug)]
struct Silence {
    since_ns: u64,
    is_said: bool,
}

impl Shell {
    /// Joins as a stage; fails when another process is that stage already.
    pub fn stage(
        options: ShellOptions,
        stage: Stage,
        shutdown: Shutdown,
    ) -> Result<Shell, RuntimeError> {
        let membership = Membership::join(&options.instance, stage.name())?;
        let claim = membership.claim(stage.name())?;
        let node = node::join(&options.instance, stage.name(), Cleaning::Yes)?;
        let heartbeat = Heartbeat::open(&node, &options.instance, stage)?;
        let mut shell = Shell::join(options, membership, Some(claim), node, shutdown)?;
        shell.heartbeat = Some(heartbeat);
        shell.follow_run()?;
        shell.beat()?;
        Ok(shell)
    }

    /// Joins as one that looks on: supervisor, status. With a `role`, only one process may have it.
    pub fn observer(
        options: ShellOptions,
        role: Option<&str>,
        shutdown: Shutdown,
    ) -> Result<Shell, RuntimeError> {
        let membership = Membership::join(&options.instance, role.unwrap_or("observer"))?;
        let claim = role.map(|role| membership.claim(role)).transpose()?;
        let node = node::join(&options.instance, role.unwrap_or("observer"), Cleaning::No)?;
        Shell::join(options, membership, claim, node, shutdown)
    }

    fn join(
        options: ShellOptions,
        membership: Membership,
        claim: Option<Claim>,
        node: Node<Ipc>,
        shutdown: Shutdown,
    ) -> Result<Shell, RuntimeError> {
        Ok(Shell {
            heartbeat: None,
            run: RunWatch::open(&node, &options.instance)?,
            run_writer: None,
            model: None,
            node,
            _claim: claim,
            membership,
            options,
            prefault: Prefault::default(),
            touched_ns: 0,
            shutdown,
            silence: None,
            counters: Counters::default(),
        })
    }

    /// The shared segment (its inode) that `elements` lie in; `None` when they lie elsewhere. For proofs, not for frames.
    pub fn segment_of<T>(&self, elements: &[T]) -> Option<u64> {
        mapping::segment_of(&self.options.instance, elements).map(|mapping| mapping.inode)
    }

    /// Whether this process was asked to end.
    pub fn is_stopping(&self) -> bool {
        self.shutdown.is_requested()
    }

    /// Which pipeline.
    pub fn instance(&self) -> &Instance {
        self.membership.instance()
    }

    /// Begins a new run and describes it to everybody, now and later. False: another process of the instance describes the
    /// run already ([`Shell::await_run`] gives its description).
    pub fn begin_run(&mut self, description: &RunDescription) -> Result<bool, RuntimeError> {
        // Of the run that this process began before.
        self.run_writer = None;
        let claim = match self.membership.claim(run::ROLE) {
            Err(RuntimeError::AlreadyRunning { .. }) => return Ok(false),
            claimed => claimed?,
        };
        let output = self.output(&Topic::RUN, 1)?;
        self.run_writer = Some(RunWriter::begin(output, claim, description)?);
        self.run.set(*description);
        self.follow_run()?;
        Ok(true)
    }

    /// The run that this process takes part in.
    pub fn run(&self) -> Option<&RunDescription> {
        self.run.current()
    }

    /// Messages are refused while the run has another model than this one.
    pub fn set_model(&mut self, fingerprint: u64) {
        self.model = Some(fingerprint);
    }

    pub(crate) fn check_model(&self) -> Result<(), ContractError> {
        match (self.model, self.run.current()) {
            (Some(own), Some(run)) if own != run.model_fingerprint => {
                Err(ContractError::Mismatch {
                    what: "fingerprint of the model (all stages must run the same model)",
                    expected: own,
                    found: run.model_fingerprint,
                })
            }
            _ => Ok(()),
        }
    }

    /// Takes a newer description of the run; the heartbeats carry its id from now on.
    fn follow_run(&mut self) -> Result<(), RuntimeError> {
        self.run.update()?;
        let id = self.run.id();
        if self.heartbeat.as_mut().is_some_and(|h| h.set_run(id)) {
            self.beat()
        } else {
            Ok(())
        }
    }

    /// Waits until a run is known, with heartbeats. `None`: it is known; else how the wait ended.
    pub fn await_run<T: Pod + Debug + ZeroCopySend>(
        &mut self,
        timeout: Duration,
    ) -> Result<Option<Next<T>>, RuntimeError> {
        let begun_ns = monotonic_ns();
        let mut is_said = false;
        while self.run.current().is_none() {
            if self.is_stopping() {
                return Ok(Some(Next::Stopping));
            }
            let waited_ns = monotonic_ns() - begun_ns;
            if u128::from(waited_ns) > timeout.as_nanos() {
                return Ok(Some(Next::Timeout));
            }
            if waited_ns > Topic::RUN.deadline_ms * 1_000_000 && !is_said {
                is_said = true;
                let reason = "waiting for the run: no pipeline and no ingest is running";
                tracing::info!("{reason}");
                self.state(HealthState::WaitingInput, reason)?;
            }
            self.tick()?;
            std::thread::sleep(RUN_POLL);
        }
        Ok(None)
    }

    /// The producer's end of a topic, for messages of up to `elements_max` elements.
    pub fn output<T: Pod + Debug + ZeroCopySend>(
        &mut self,
        topic: &Topic,
        elements_max: usize,
    ) -> Result<Output<T>, RuntimeError> {
        let output = Output::open(
            &self.node,
            &self.options.instance,
            topic,
            topic.name,
            elements_max.min(topic.elements_max),
        )?;
        self.touch();
        Ok(output)
    }

    /// The consumer's end of a topic that this process waits for.
    pub fn input<T: Pod + Debug + ZeroCopySend>(
        &self,
        topic: &Topic,
    ) -> Result<Input<T>, RuntimeError> {
        self.open_input(topic, true)
    }

    /// The consumer's end of a topic that this process only looks at.
    pub fn side_input<T: Pod + Debug + ZeroCopySend>(
        &self,
        topic: &Topic,
    ) -> Result<Input<T>, RuntimeError> {
        self.open_input(topic, false)
    }

    fn open_input<T: Pod + Debug + ZeroCopySend>(
        &self,
        topic: &Topic,
        wakes: bool,
    ) -> Result<Input<T>, RuntimeError> {
        let options = InputOptions {
            wakes,
            verify_mapping: self.options.verify_mapping,
        };
        Input::open(
            &self.node,
            &self.options.instance,
            topic,
            topic.name,
            options,
        )
    }

    /// All stages' heartbeats.
    pub fn health_watch(&self) -> Result<HealthWatch, RuntimeError> {
        HealthWatch::open(&self.node, &self.options.instance)
    }

    /// Waits for the newest message, with heartbeats; `None`: this process was asked to end. Says what it waits for
    /// when nothing came within the topic's deadline.
    pub fn next<T: Pod + Debug + ZeroCopySend>(
        &mut self,
        input: &mut Input<T>,
        topic: &Topic,
        mut on_tick: impl FnMut(Option<&RunDescription>) -> Result<(), RuntimeError>,
    ) -> Result<Option<Message<T>>, RuntimeError> {
        loop {
            match self.next_within(input, topic, &mut on_tick, Duration::MAX)? {
                Next::Message(message) => return Ok(Some(message)),
                Next::Stopping => return Ok(None),
                Next::Timeout => (),
            }
        }
    }

    /// The same, and gives up after `timeout`. Silence is counted over the calls.
    pub fn next_within<T: Pod + Debug + ZeroCopySend>(
        &mut self,
        input: &mut Input<T>,
        topic: &Topic,
        mut on_tick: impl FnMut(Option<&RunDescription>) -> Result<(), RuntimeError>,
        timeout: Duration,
    ) -> Result<Next<T>, RuntimeError> {
        let begun_ns = monotonic_ns();
        self.silence.get_or_insert(Silence {
            since_ns: begun_ns,
            is_said: false,
        });
        loop {
            if self.is_stopping() {
                return Ok(Next::Stopping);
            }
            self.follow_run()?;
            on_tick(self.run.current())?;
            // A wake-up whose message was taken already ends the wait below early, once: forgetting it here would cost two
            // system calls between a wake-up and its message.
            if let Some(message) = input.newest()? {
                self.end_silence(topic);
                return Ok(Next::Message(message));
            }
            self.say_silence(input, topic)?;
            self.touch_when_due();
            self.tick()?;
            let left = timeout.saturating_sub(Duration::from_nanos(monotonic_ns() - begun_ns));
            if left.is_zero() {
                return Ok(Next::Timeout);
            }
            input.wait(left.min(TICK));
        }
    }

    /// Says once what is missing, when the topic's deadline is over.
    fn say_silence<T: Pod + Debug + ZeroCopySend>(
        &mut self,
        input: &Input<T>,
        topic: &Topic,
    ) -> Result<(), RuntimeError> {
        let deadline_ns = topic.deadline_ms * 1_000_000;
        match &mut self.silence {
            Some(silence)
                if !silence.is_said && monotonic_ns() - silence.since_ns > deadline_ns =>
            {
                silence.is_said = true;
            }
            _ => return Ok(()),
        }
        let reason = waiting_for(input, topic);
        tracing::info!("{reason}");
        self.state(HealthState::WaitingInput, &reason)
    }

    fn end_silence(&mut self, topic: &Topic) {
        if let Some(silence) = self.silence.take()
            && silence.is_said
        {
            let waited_ms = (monotonic_ns() - silence.since_ns) / 1_000_000;
            tracing::info!(waited_ms, "{} arrive", topic.name);
        }
    }

    /// Refuses a message that breaks the contract or comes of another model: counted, said, and the next one is taken.
    pub fn refuse(&mut self, why: &str) -> Result<(), RuntimeError> {
        self.counters.messages_refused += 1;
        let count = self.counters.messages_refused;
        // A lasting cause would fill the log at the sensor's rate.
        if count <= 3 || count.is_multiple_of(100) {
            tracing::warn!(count, "message refused: {why}");
        }
        self.state(HealthState::Degraded, why)
    }

    /// Waits at most `timeout` for a message on `input`, without taking it.
    pub fn wait<T: Pod + Debug + ZeroCopySend>(&self, input: &Input<T>, timeout: Duration) {
        input.wait(timeout);
    }

    /// Says how this stage is; logged and published when it changes.
    pub fn state(&mut self, state: HealthState, reason: &str) -> Result<(), RuntimeError> {
        let heartbeat = self.heartbeat.as_mut();
        if heartbeat.is_some_and(|heartbeat| heartbeat.set(state, reason)) {
            self.beat()
        } else {
            Ok(())
        }
    }

    /// How long the stage computed for a frame.
    pub fn record_run(&mut self, run_ns: u64) {
        if let Some(heartbeat) = &mut self.heartbeat {
            heartbeat.record_run(run_ns);
        }
    }

    /// What is to be done now and then: a look for a new run, the description for late readers, a heartbeat.
    pub fn tick(&mut self) -> Result<(), RuntimeError> {
        self.follow_run()?;
        if let Some(writer) = &self.run_writer {
            writer.reach_late_readers()?;
        }
        if self.heartbeat.as_ref().is_some_and(Heartbeat::is_due) {
            self.beat()
        } else {
            Ok(())
        }
    }

    /// A heartbeat now.
    pub fn beat(&mut self) -> Result<(), RuntimeError> {
        match &mut self.heartbeat {
            Some(heartbeat) => heartbeat.publish(&self.counters),
            None => Ok(()),
        }
    }

    /// Touches segments that other processes made, now and then, and only while there is nothing to do: reading this
    /// process's map takes 0.1 ms, for which the consumer of a message just sent may wait where cores are few.
    fn touch_when_due(&mut self) {
        if monotonic_ns() - self.touched_ns >= TOUCH_PERIOD_NS {
            self.touch();
        }
    }

    fn touch(&mut self) {
        self.touched_ns = monotonic_ns();
        if self.options.prefault {
            self.prefault.touch(&self.options.instance);
        }
    }
}

/// Between two looks for new segments.
const TOUCH_PERIOD_NS: u64 = 100_000_000;
/// Between two looks for the first description of a run.
const RUN_POLL: Duration = Duration::from_millis(5);
/// How often a waiting process looks around: also the longest time until it sees a signal.
const TICK: Duration = Duration::from_millis(50);

fn waiting_for<T: Pod + Debug + ZeroCopySend>(input: &Input<T>, topic: &Topic) -> String {
    match input.producers() {
        0 => format!("waiting for {}: no producer is running", topic.name),
        _ => format!("waiting for {}: their producer is silent", topic.name),
    }
}
