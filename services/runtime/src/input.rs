//! The consumer's end of a topic.

use std::fmt::Debug;
use std::time::Duration;

use bytemuck::Pod;
use iceoryx2::node::Node;
use iceoryx2::port::listener::Listener;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::ZeroCopySend;
use iceoryx2::sample::Sample;
use mluc_ipc_types::{FrameHeader, Topic};

use crate::node::{DataService, WakeService, open_data, open_wake, topic_error};
use crate::{Instance, Ipc, RuntimeError, mapping, monotonic_ns};

/// Takes messages of a topic.
pub struct Input<T: Pod + Debug + ZeroCopySend> {
    subscriber: Subscriber<Ipc, [T], FrameHeader>,
    listener: Option<Listener<Ipc>>,
    service: DataService<T>,
    _wake: Option<WakeService>,
    instance: Instance,
    name: String,
    verify_mapping: bool,
    bytes_read: u64,
    mappings_verified: u64,
}

/// How an input is opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct InputOptions {
    pub(crate) wakes: bool,
    pub(crate) verify_mapping: bool,
}

impl<T: Pod + Debug + ZeroCopySend> Input<T> {
    pub(crate) fn open(
        node: &Node<Ipc>,
        instance: &Instance,
        topic: &Topic,
        name: &str,
        options: InputOptions,
    ) -> Result<Input<T>, RuntimeError> {
        let service = open_data::<T>(node, instance, topic, name)?;
        let failed = |cause: String| topic_error(instance, name, cause, "");
        let subscriber = service
            .subscriber_builder()
            .create()
            .map_err(|e| failed(format!("no place for another consumer ({e:?})")))?;
        let wake = if options.wakes {
            Some(open_wake(node, instance, topic, name)?)
        } else {
            None
        };
        let listener = match &wake {
            Some(wake) => Some(
                wake.listener_builder()
                    .create()
                    .map_err(|e| failed(format!("{e:?}")))?,
            ),
            None => None,
        };
        Ok(Input {
            subscriber,
            listener,
            service,
            _wake: wake,
            instance: instance.clone(),
            name: name.to_string(),
            verify_mapping: options.verify_mapping,
            bytes_read: 0,
            mappings_verified: 0,
        })
    }

    /// The newest message; older ones that wait are let go.
    pub fn newest(&mut self) -> Result<Option<Message<T>>, RuntimeError> {
        let mut newest = None;
        // The older one is let go before the next is taken: a topic may allow one held message alone.
        while newest.is_none() || self.has_more()? {
            drop(newest);
            newest = self.take()?;
            if newest.is_none() {
                break;
            }
        }
        self.account(newest)
    }

    /// The oldest message that waits.
    pub fn oldest(&mut self) -> Result<Option<Message<T>>, RuntimeError> {
        let oldest = self.take()?;
        self.account(oldest)
    }

    fn has_more(&self) -> Result<bool, RuntimeError> {
        self.subscriber
            .has_samples()
            .map_err(|e| RuntimeError::Message {
                topic: self.name.clone(),
                action: "looking for messages",
                cause: format!("{e:?}"),
            })
    }

    fn take(&mut self) -> Result<Option<Message<T>>, RuntimeError> {
        let sample = self
            .subscriber
            .receive()
            .map_err(|e| RuntimeError::Message {
                topic: self.name.clone(),
                action: "taking a message",
                cause: format!("{e:?}"),
            })?;
        Ok(sample.map(|sample| Message {
            sample,
            received_ns: monotonic_ns(),
        }))
    }

    fn account(&mut self, message: Option<Message<T>>) -> Result<Option<Message<T>>, RuntimeError> {
        let Some(message) = message else {
            return Ok(None);
        };
        self.bytes_read += size_of_val(message.elements()) as u64;
        if self.verify_mapping && !message.elements().is_empty() {
            if mapping::segment_of(&self.instance, message.elements()).is_none() {
                return Err(RuntimeError::OutsideOfMapping {
                    topic: self.name.clone(),
                    instance: self.instance.name().to_string(),
                });
            }
            self.mappings_verified += 1;
        }
        Ok(Some(message))
    }

    /// Sleeps until the producer sends or `timeout` has passed. Without a listener: sleeps.
    pub(crate) fn wait(&self, timeout: Duration) {
        // An error here is a signal that arrived, or a listener that is gone: the caller looks and comes back.
        let woken = match &self.listener {
            Some(listener) => listener.timed_wait(|_| (), timeout).is_ok(),
            None => false,
        };
        if !woken {
            std::thread::sleep(timeout.min(Duration::from_millis(5)));
        }
    }

    /// The topic's name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Producers connected at this time: 0 or 1.
    pub fn producers(&self) -> usize {
        use iceoryx2::prelude::PortFactory;
        self.service.dynamic_config().number_of_publishers()
    }

    /// Consumers connected at this time, this one included.
    pub fn consumers(&self) -> usize {
        use iceoryx2::prelude::PortFactory;
        self.service.dynamic_config().number_of_subscribers()
    }

    /// Payload bytes of everything taken.
    pub fn bytes_read(&self) -> u64 {
        self.bytes_read
    }

    /// Messages whose payload was found inside a mapped segment of the instance.
    pub fn mappings_verified(&self) -> u64 {
        self.mappings_verified
    }
}

/// A message in shared memory, held until dropped.
pub struct Message<T: Pod + Debug + ZeroCopySend> {
    sample: Sample<Ipc, [T], FrameHeader>,
    /// When it was taken from the queue, CLOCK_MONOTONIC.
    pub received_ns: u64,
}

impl<T: Pod + Debug + ZeroCopySend> Message<T> {
    /// The header, unchecked: the payload's own `checked` function looks at it.
    pub fn header(&self) -> &FrameHeader {
        self.sample.user_header()
    }

    /// The elements where they lie in shared memory, unchecked.
    pub fn elements(&self) -> &[T] {
        self.sample.payload()
    }
}
