//! The consumer's end of a topic.

use crate::error::{Result, refusal};
use crate::node::{DataService, IpcNode, WakeService};
use crate::{Instance, Ipc, Payload, RuntimeError, mapping, monotonic_ns};
use iceoryx2::sample::Sample;
use iceoryx2::{port::listener::Listener, port::subscriber::Subscriber, prelude::PortFactory};
use mluc_ipc_types::{FrameHeader, Topic};
use std::{rc::Rc, time::Duration};

/// Longest sleep of a wait that no listener can end.
const BLIND_WAIT: Duration = Duration::from_millis(5);

/// Sleeps until the producer of a topic sends.
#[derive(Clone)]
pub(crate) struct Wake(Rc<(Listener<Ipc>, WakeService)>);

impl Wake {
    pub(crate) fn wait(&self, timeout: Duration) {
        // The error is a signal that arrived or a listener that is gone. The caller checks its state and waits again.
        if self.0.0.timed_wait(|_| (), timeout).is_err() {
            std::thread::sleep(timeout.min(BLIND_WAIT));
        }
    }
}

/// Takes messages of a topic.
pub struct Input<T: Payload> {
    subscriber: Subscriber<Ipc, [T], FrameHeader>,
    wake: Option<Wake>,
    service: DataService<T>,
    instance: Instance,
    name: String,
    elements_max: usize,
    /// Each payload must lie in a mapped segment of the instance.
    pub(crate) verify_mapping: bool,
    mappings_verified: u64,
}

impl<T: Payload> Input<T> {
    /// `wakes`: whether the producer ends a wait on this input.
    pub(crate) fn open(node: &IpcNode, topic: &Topic, name: &str, wakes: bool) -> Result<Input<T>> {
        let service = node.open_data::<T>(topic, name)?;
        let failed = |cause: String| RuntimeError::topic(node.instance.name(), name, cause);
        let subscriber = service.subscriber_builder().create();
        let subscriber = subscriber.map_err(|e| failed(refusal("consumer", &format!("{e:?}"))))?;
        let mut wake = None;
        if wakes {
            let service = node.open_wake(topic, name)?;
            let listener = service.listener_builder().create();
            let listener = listener.map_err(|e| failed(format!("{e:?}")))?;
            wake = Some(Wake(Rc::new((listener, service))));
        }
        Ok(Input {
            subscriber,
            wake,
            service,
            instance: node.instance.clone(),
            name: name.to_string(),
            elements_max: topic.elements_max,
            verify_mapping: false,
            mappings_verified: 0,
        })
    }

    /// The newest message; older waiting messages are discarded.
    pub fn newest(&mut self) -> Result<Option<Message<T>>> {
        let mut newest = self.take()?;
        // The older message is dropped before the next is taken: a topic may allow only one held message.
        while newest.is_some() && self.has_more()? {
            drop(newest);
            newest = self.take()?;
        }
        self.verified(newest)
    }

    /// The oldest message that waits.
    pub fn oldest(&mut self) -> Result<Option<Message<T>>> {
        let oldest = self.take()?;
        self.verified(oldest)
    }

    fn has_more(&self) -> Result<bool> {
        let has_samples = self.subscriber.has_samples();
        has_samples.map_err(|e| self.failed(format!("looking for messages: {e:?}")))
    }

    fn take(&mut self) -> Result<Option<Message<T>>> {
        let sample = self.subscriber.receive();
        let sample = sample.map_err(|e| self.failed(format!("taking a message: {e:?}")))?;
        Ok(sample.map(|sample| Message {
            sample,
            received_ns: monotonic_ns(),
            // One more than the limit, so that the check of the length sees an oversized message.
            elements_seen: self.elements_max + 1,
        }))
    }

    fn verified(&mut self, message: Option<Message<T>>) -> Result<Option<Message<T>>> {
        let elements = message.as_ref().map_or(&[][..], Message::elements);
        if self.verify_mapping && !elements.is_empty() {
            if mapping::segment_of(&self.instance, elements).is_none() {
                let cause = "a payload lies outside of the instance's shared segments";
                return Err(self.failed(cause.to_string()));
            }
            self.mappings_verified += 1;
        }
        Ok(message)
    }

    /// Sleeps until the producer sends or `timeout` has passed. Takes no message.
    pub fn wait(&self, timeout: Duration) {
        match &self.wake {
            Some(wake) => wake.wait(timeout),
            None => std::thread::sleep(timeout.min(BLIND_WAIT)),
        }
    }

    /// The listener that [`Input::wait`] sleeps on, for a caller that waits on it directly.
    pub(crate) fn wake(&self) -> Option<Wake> {
        self.wake.clone()
    }

    /// The topic's name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Producers connected at this time: 0 or 1.
    pub fn producers(&self) -> usize {
        self.service.dynamic_config().number_of_publishers()
    }

    /// Messages whose payload was found inside a mapped segment of the instance.
    pub fn mappings_verified(&self) -> u64 {
        self.mappings_verified
    }

    fn failed(&self, cause: String) -> RuntimeError {
        RuntimeError::topic(self.instance.name(), &self.name, cause)
    }
}

/// A message in shared memory, held until dropped.
pub struct Message<T: Payload> {
    sample: Sample<Ipc, [T], FrameHeader>,
    /// When it was taken from the queue, CLOCK_MONOTONIC.
    pub received_ns: u64,
    elements_seen: usize,
}

impl<T: Payload> Message<T> {
    /// The header, unchecked: the payload's own `checked` function checks it.
    pub fn header(&self) -> &FrameHeader {
        self.sample.user_header()
    }

    /// The elements in shared memory, unchecked. There are at most one more than the topic's limit, whatever count the producer gives.
    pub fn elements(&self) -> &[T] {
        let all = self.sample.payload();
        &all[..all.len().min(self.elements_seen)]
    }
}
