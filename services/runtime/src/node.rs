//! iceoryx2's node of this process, and opening services from the one table.

use std::fmt::Debug;
use std::time::{Duration, Instant};

use iceoryx2::node::{Node, NodeBuilder};
use iceoryx2::prelude::{
    Config, FileName, LogLevel, NodeName, Path, SemanticString, ServiceName, SignalHandlingMode,
    ZeroCopySend, set_log_level,
};
use iceoryx2::service::builder::publish_subscribe::{
    PublishSubscribeOpenError, PublishSubscribeOpenOrCreateError,
};
use iceoryx2::service::port_factory::{event, publish_subscribe};
use mluc_ipc_types::{FrameHeader, Topic};

use crate::{Instance, Ipc, RuntimeError, sweep};

pub(crate) type DataService<T> = publish_subscribe::PortFactory<Ipc, [T], FrameHeader>;
pub(crate) type WakeService = event::PortFactory<Ipc>;

/// Processes that may open a service: four stages, supervisor, and tools.
const NODES_MAX: usize = 16;
/// How long another process may take to make or remove a service; a guess with room.
const OPEN_PATIENCE: Duration = Duration::from_secs(3);

/// Whether this process removes what killed processes left. The supervisor does not: its stages do when they start, each
/// under the supervisor's eye, so that a cleaning that hangs never hangs the supervisor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Cleaning {
    Yes,
    No,
}

pub(crate) fn config(instance: &Instance, cleaning: Cleaning) -> Result<Config, RuntimeError> {
    let failed = |cause: String| RuntimeError::Node {
        instance: instance.name().to_string(),
        cause,
    };
    let mut config = Config::default();
    let root = Path::new(instance.root().to_string_lossy().as_bytes())
        .map_err(|e| failed(format!("root path: {e:?}")))?;
    config.global.set_root_path(&root);
    config.global.prefix = FileName::new(instance.prefix().as_bytes())
        .map_err(|e| failed(format!("prefix: {e:?}")))?;
    let cleans = cleaning == Cleaning::Yes;
    config.global.node.cleanup_dead_nodes_on_creation = cleans;
    config.global.node.cleanup_dead_nodes_on_destruction = false;
    config.global.service.cleanup_dead_nodes_on_open = cleans;
    Ok(config)
}

pub(crate) fn join(
    instance: &Instance,
    role: &str,
    cleaning: Cleaning,
) -> Result<Node<Ipc>, RuntimeError> {
    let failed = |cause: String| RuntimeError::Node {
        instance: instance.name().to_string(),
        cause,
    };
    set_log_level(LogLevel::Fatal);
    let count = sweep::sweep_stillborn(instance);
    if count > 0 {
        tracing::warn!(
            count,
            "removed segments that a killed process never finished"
        );
    }
    let name = NodeName::new(role).map_err(|e| failed(format!("{e:?}")))?;
    let node = NodeBuilder::new()
        .name(&name)
        .config(&config(instance, cleaning)?)
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .create::<Ipc>()
        .map_err(|e| failed(format!("{e:?}")))?;
    sweep::close_to_others(instance);
    Ok(node)
}

/// Opens or makes the service that carries a topic's messages, with the table's settings. `name` is the topic's, or
/// `health/<stage>`.
pub(crate) fn open_data<T: Debug + ZeroCopySend + 'static>(
    node: &Node<Ipc>,
    instance: &Instance,
    topic: &Topic,
    name: &str,
) -> Result<DataService<T>, RuntimeError> {
    let service_name = service_name(instance, name)?;
    let open = || {
        node.service_builder(&service_name)
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
    retried(instance, name, open, is_lasting)
}

/// Opens or makes the service that wakes a topic's consumers.
pub(crate) fn open_wake(
    node: &Node<Ipc>,
    instance: &Instance,
    topic: &Topic,
    name: &str,
) -> Result<WakeService, RuntimeError> {
    let service_name = service_name(instance, name)?;
    // A killed producer's notifier keeps its place until it is cleaned: room for its successor.
    let open = || {
        node.service_builder(&service_name)
            .event()
            .max_notifiers(4)
            .max_listeners(topic.subscribers_max)
            .max_nodes(NODES_MAX)
            .event_id_max_value(1)
            .open_or_create()
    };
    retried(instance, name, open, |_| false)
}

fn service_name(instance: &Instance, name: &str) -> Result<ServiceName, RuntimeError> {
    ServiceName::new(&format!("mluc/{name}"))
        .map_err(|e| topic_error(instance, name, format!("{e:?}"), ""))
}

/// Other processes make and remove services at the same time: all but lasting errors get more tries.
fn retried<S, E: Debug>(
    instance: &Instance,
    name: &str,
    open: impl Fn() -> Result<S, E>,
    is_lasting: impl Fn(&E) -> bool,
) -> Result<S, RuntimeError> {
    let begun = Instant::now();
    loop {
        match open() {
            Ok(service) => return Ok(service),
            Err(error) if is_lasting(&error) => {
                let hint = ": another program or another mluc made it with other types or settings; stop that one, or \
                            choose another --instance";
                return Err(topic_error(instance, name, format!("{error:?}"), hint));
            }
            Err(error) if begun.elapsed() > OPEN_PATIENCE => {
                let hint = ": a process was killed while it made this topic; stop all processes of the instance, the \
                            next start removes the rest";
                return Err(topic_error(instance, name, format!("{error:?}"), hint));
            }
            Err(_) => std::thread::sleep(Duration::from_millis(20)),
        }
    }
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

pub(crate) fn topic_error(
    instance: &Instance,
    topic: &str,
    cause: String,
    hint: &'static str,
) -> RuntimeError {
    RuntimeError::Topic {
        topic: topic.to_string(),
        instance: instance.name().to_string(),
        cause,
        hint,
    }
}
