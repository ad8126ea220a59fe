//! iceoryx2's node of this process, and opening services from the one table.

use crate::{Instance, Ipc, Payload, RuntimeError, error::Result, sweep};
use iceoryx2::node::{Node, NodeBuilder, NodeState};
use iceoryx2::prelude::{
    CallbackProgression, Config, FileName, LogLevel, NodeName, Path, SemanticString, ServiceName,
    SignalHandlingMode, set_log_level,
};
use iceoryx2::service::builder::publish_subscribe::{
    PublishSubscribeOpenError, PublishSubscribeOpenOrCreateError,
};
use iceoryx2::service::port_factory::{event, publish_subscribe};
use mluc_ipc_types::{FrameHeader, Topic};
use std::{fmt::Debug, time::Duration, time::Instant};

pub(crate) type DataService<T> = publish_subscribe::PortFactory<Ipc, [T], FrameHeader>;
pub(crate) type WakeService = event::PortFactory<Ipc>;

/// Processes that may open a service: four stages, supervisor, and tools.
const NODES_MAX: usize = 16;
/// How long another process may take to make or remove a service; a generous guess.
const OPEN_PATIENCE: Duration = Duration::from_secs(3);

/// This process's node in an instance.
pub(crate) struct IpcNode {
    node: Node<Ipc>,
    pub(crate) instance: Instance,
}

impl IpcNode {
    /// `cleans`: whether this process removes what killed processes left. Stages do so when they start, and so do consumers. The
    /// supervisor does not: it watches the stages, so a cleaning that hangs never hangs the supervisor.
    pub(crate) fn join(instance: &Instance, role: &str, cleans: bool) -> Result<IpcNode> {
        set_log_level(LogLevel::Fatal);
        let count = sweep::sweep_stillborn(instance);
        if count > 0 {
            let what = "segments that a killed process never finished";
            tracing::warn!(count, "removed {what}");
        }
        let name = instance.name();
        let failed = |cause: String| RuntimeError::instance(name, format!("joining: {cause}"));
        sweep::make_management_segment(instance)?;
        let name = NodeName::new(role).map_err(|e| failed(format!("{e:?}")))?;
        let config = config(instance, cleans).map_err(failed)?;
        let node = NodeBuilder::new()
            .name(&name)
            .config(&config)
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<Ipc>()
            .map_err(|e| failed(format!("{e:?}")))?;
        sweep::close_to_others(instance);
        Ok(IpcNode { node, instance: instance.clone() })
    }

    /// Whether a process died in the instance and its ports were not removed.
    pub(crate) fn has_dead(&self) -> bool {
        let mut has_dead = false;
        let _ = Node::<Ipc>::list(self.node.config(), |state| {
            has_dead |= matches!(state, NodeState::Dead(_));
            CallbackProgression::Continue
        });
        has_dead
    }

    /// Opens or makes the service that carries a topic's messages, with the table's settings. `name` is the topic's, or
    /// `health/<stage>`.
    pub(crate) fn open_data<T: Payload>(
        &self,
        topic: &Topic,
        name: &str,
    ) -> Result<DataService<T>> {
        let open = |name: &ServiceName| {
            self.node
                .service_builder(name)
                .publish_subscribe::<[T]>()
                .user_header::<FrameHeader>()
                .enable_safe_overflow(true)
                .max_publishers(1)
                .max_subscribers(topic.subscribers_max)
                .subscriber_max_buffer_size(topic.buffer)
                .subscriber_max_borrowed_samples(topic.borrowed)
                .history_size(topic.history)
                .max_nodes(NODES_MAX)
                .open_or_create()
        };
        self.retried(name, open, is_lasting)
    }

    /// Opens or makes the service that wakes a topic's consumers.
    pub(crate) fn open_wake(&self, topic: &Topic, name: &str) -> Result<WakeService> {
        // A killed producer's notifier keeps its slot until it is cleaned up: the limit leaves a slot for its successor.
        let open = |name: &ServiceName| {
            self.node
                .service_builder(name)
                .event()
                .max_notifiers(4)
                .max_listeners(topic.subscribers_max)
                .max_nodes(NODES_MAX)
                .event_id_max_value(1)
                .open_or_create()
        };
        self.retried(name, open, |_| false)
    }

    /// Retries all errors except lasting ones, because other processes make and remove services at the same time.
    fn retried<S, E: Debug>(
        &self,
        name: &str,
        open: impl Fn(&ServiceName) -> std::result::Result<S, E>,
        is_lasting: impl Fn(&E) -> bool,
    ) -> Result<S> {
        let failed = |cause: String| RuntimeError::topic(self.instance.name(), name, cause);
        let service_name = ServiceName::new(&format!("mluc/{name}"));
        let service_name = service_name.map_err(|e| failed(format!("{e:?}")))?;
        let begun = Instant::now();
        loop {
            let error = match open(&service_name) {
                Ok(service) => return Ok(service),
                Err(error) => error,
            };
            let hint = if is_lasting(&error) {
                "another program or another mluc made it with other types or settings; stop that one, or choose another \
                 --instance"
            } else if begun.elapsed() > OPEN_PATIENCE {
                "a process was killed while it made this topic; stop all processes of the instance, the next start removes \
                 the rest"
            } else {
                std::thread::sleep(Duration::from_millis(20));
                continue;
            };
            return Err(failed(format!("{error:?}: {hint}")));
        }
    }
}

fn config(instance: &Instance, cleans: bool) -> std::result::Result<Config, String> {
    let mut config = Config::default();
    let root = Path::new(instance.root().to_string_lossy().as_bytes())
        .map_err(|e| format!("root path: {e:?}"))?;
    config.global.set_root_path(&root);
    config.global.prefix =
        FileName::new(instance.prefix().as_bytes()).map_err(|e| format!("prefix: {e:?}"))?;
    config.global.node.cleanup_dead_nodes_on_creation = cleans;
    config.global.node.cleanup_dead_nodes_on_destruction = false;
    config.global.service.cleanup_dead_nodes_on_open = cleans;
    Ok(config)
}

fn is_lasting(error: &PublishSubscribeOpenOrCreateError) -> bool {
    use PublishSubscribeOpenError as E;
    let PublishSubscribeOpenOrCreateError::PublishSubscribeOpenError(error) = error else {
        return false;
    };
    matches!(
        error,
        E::IncompatibleTypes
            | E::IncompatibleMessagingPattern
            | E::IncompatibleAttributes
            | E::DoesNotSupportRequestedMinBufferSize
            | E::DoesNotSupportRequestedMinHistorySize
            | E::DoesNotSupportRequestedMinSubscriberBorrowedSamples
            | E::DoesNotSupportRequestedAmountOfPublishers
            | E::DoesNotSupportRequestedAmountOfSubscribers
            | E::IncompatibleOverflowBehavior
            | E::InsufficientPermissions
            | E::VersionMismatch
    )
}
