//! iceoryx2 alone: the same services, header and elements, and nothing around them.

use std::time::Instant;

use anyhow::{Context, Result, bail};
use iceoryx2::node::{Node, NodeBuilder};
use iceoryx2::prelude::{
    AllocationStrategy, BackpressureStrategy, Config, FileName, Path, SemanticString, ServiceName,
    SignalHandlingMode,
};
use iceoryx2::service::ipc::Service as Ipc;
use iceoryx2::service::port_factory::event::PortFactory as Event;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory as PubSub;
use mluc_ipc_types::{FrameHeader, Topic};
use mluc_runtime::{Membership, monotonic_ns};

use super::{
    Arrived, Element, Link, PATIENCE, Receiver, Sender, Sent, Way, element_of, read, silence,
    sum_of,
};
use crate::transport::load::Wake;

/// A process's place among the others. Drop it last: the last member removes all files.
struct Place {
    node: Node<Ipc>,
    _member: Membership,
}

impl Place {
    fn join(link: &Link) -> Result<Place> {
        let instance = link.instance(Way::Raw)?;
        let member = Membership::join(&instance, "raw")?;
        let mut config = Config::default();
        let root = instance.root().to_string_lossy().into_owned();
        let root = Path::new(root.as_bytes()).context("a root path")?;
        config.global.set_root_path(&root);
        config.global.prefix = FileName::new(instance.prefix().as_bytes()).context("a prefix")?;
        let node = NodeBuilder::new()
            .config(&config)
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<Ipc>()
            .context("joining iceoryx2")?;
        Ok(Place {
            node,
            _member: member,
        })
    }

    fn data<T: Element>(&self, topic: &Topic) -> Result<PubSub<Ipc, [T], FrameHeader>> {
        self.node
            .service_builder(&ServiceName::new("data")?)
            .publish_subscribe::<[T]>()
            .user_header::<FrameHeader>()
            .enable_safe_overflow(true)
            .max_publishers(1)
            .max_subscribers(topic.subscribers_max)
            .subscriber_max_buffer_size(topic.buffer)
            .subscriber_max_borrowed_samples(topic.borrowed)
            .history_size(topic.history)
            .open_or_create()
            .context("opening a service")
    }

    /// `None`: the receiver polls.
    fn wake(&self, link: &Link) -> Result<Option<Event<Ipc>>> {
        if link.wake == Wake::Poll {
            return Ok(None);
        }
        self.node
            .service_builder(&ServiceName::new("wake")?)
            .event()
            .max_notifiers(4)
            .max_listeners(link.load.payload.topic().subscribers_max)
            .event_id_max_value(1)
            .open_or_create()
            .context("opening an event")
            .map(Some)
    }
}

pub(super) fn sender<T: Element>(link: &Link) -> Result<Sender> {
    let (place, topic) = (Place::join(link)?, link.load.payload.topic());
    let elements = link.load.elements();
    let publisher = place
        .data::<T>(topic)?
        .publisher_builder()
        .initial_max_slice_len(elements)
        .allocation_strategy(AllocationStrategy::Static)
        .max_loaned_samples(topic.loans)
        .backpressure_strategy(BackpressureStrategy::DiscardData)
        .create()
        .context("making a publisher")?;
    let notifier = place
        .wake(link)?
        .map(|wake| wake.notifier_builder().create());
    let notifier = notifier.transpose().context("making a notifier")?;
    let end = (publisher, notifier, place);
    Ok(Box::new(move |word| {
        let (publisher, notifier, _) = &end;
        let asked_ns = monotonic_ns();
        let sample = publisher.loan_slice_uninit(elements);
        let sample = sample.context("lending memory")?;
        let lent_ns = monotonic_ns();
        let element = element_of(word);
        let mut sample = sample.write_from_fn(|_| element);
        let at_ns = monotonic_ns();
        sample.user_header_mut().stages[0].published_ns = at_ns;
        sample.send().context("sending")?;
        if let Some(notifier) = notifier {
            notifier.notify().context("waking")?;
        }
        Ok(Sent {
            at_ns,
            occupied_ns: lent_ns - asked_ns + monotonic_ns() - at_ns,
            sum: sum_of::<T>(word, elements),
        })
    }))
}

pub(super) fn receiver<T: Element>(link: &Link) -> Result<Receiver> {
    let place = Place::join(link)?;
    let data = place.data::<T>(link.load.payload.topic())?;
    let subscriber = data.subscriber_builder().create();
    let subscriber = subscriber.context("making a subscriber")?;
    let listener = place
        .wake(link)?
        .map(|wake| wake.listener_builder().create());
    let listener = listener.transpose().context("making a listener")?;
    let end = (subscriber, listener, place);
    Ok(Box::new(move || {
        let (subscriber, listener, _) = &end;
        let begun = Instant::now();
        while begun.elapsed() <= PATIENCE {
            if let Some(sample) = subscriber.receive().context("taking a message")? {
                return Ok(Arrived {
                    at_ns: monotonic_ns(),
                    sum: read(sample.payload()),
                });
            }
            match listener {
                // A wake-up of a message that is taken already ends this early: then it looks again.
                Some(listener) => {
                    let waited = listener.timed_wait(|_| (), PATIENCE);
                    waited.context("waiting")?;
                }
                None => std::hint::spin_loop(),
            }
        }
        bail!(silence(Way::Raw))
    }))
}
