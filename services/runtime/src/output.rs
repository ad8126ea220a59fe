//! The producer's end of a topic.

use std::fmt::Debug;

use bytemuck::Pod;
use iceoryx2::node::Node;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::prelude::{AllocationStrategy, BackpressureStrategy, ZeroCopySend};
use iceoryx2::sample_mut::SampleMut;
use mluc_ipc_types::{FrameHeader, Topic};

use crate::node::{DataService, WakeService, open_data, open_wake, topic_error};
use crate::{Instance, Ipc, RuntimeError};

/// Lends memory of a topic, sends it, and wakes who waits for it.
pub struct Output<T: Pod + Debug + ZeroCopySend> {
    publisher: Publisher<Ipc, [T], FrameHeader>,
    notifier: Notifier<Ipc>,
    service: DataService<T>,
    _wake: WakeService,
    name: String,
    bytes_written: u64,
}

impl<T: Pod + Debug + ZeroCopySend> Output<T> {
    /// `elements_max`: the largest message; the pool has [`Topic::slots`] times that.
    pub(crate) fn open(
        node: &Node<Ipc>,
        instance: &Instance,
        topic: &Topic,
        name: &str,
        elements_max: usize,
    ) -> Result<Output<T>, RuntimeError> {
        check_room(topic, name, elements_max * size_of::<T>())?;
        let service = open_data::<T>(node, instance, topic, name)?;
        let wake = open_wake(node, instance, topic, name)?;
        let failed = |cause: String| topic_error(instance, name, cause, "");
        let publisher = service
            .publisher_builder()
            .initial_max_slice_len(elements_max.max(1))
            .allocation_strategy(AllocationStrategy::Static)
            .max_loaned_samples(topic.loans)
            // Never met while overflow is on; the default would wait for ever for a killed consumer.
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .create()
            .map_err(|e| failed(format!("no place for another producer ({e:?})")))?;
        let notifier = wake
            .notifier_builder()
            .create()
            .map_err(|e| failed(format!("{e:?}")))?;
        Ok(Output {
            publisher,
            notifier,
            service,
            _wake: wake,
            name: name.to_string(),
            bytes_written: 0,
        })
    }

    /// Memory for a message of `elements` elements, to be filled in place. What it holds at first is anything.
    pub fn loan(
        &mut self,
        header: &FrameHeader,
        elements: usize,
    ) -> Result<Loan<'_, T>, RuntimeError> {
        let sample = self
            .publisher
            .loan_slice_uninit(elements)
            .map_err(|e| self.failed("lending memory for a message", format!("{e:?}")))?;
        #[allow(unsafe_code)]
        // SAFETY: the memory is a mapped segment, whose bytes are all initialised (by the kernel to 0, or by an earlier
        // message), and `T: Pod` takes every bit pattern.
        let mut sample = unsafe { sample.assume_init() };
        *sample.user_header_mut() = *header;
        Ok(Loan {
            sample,
            output: self,
        })
    }

    /// Connects consumers that came since the last message, which get what the topic's history holds.
    pub(crate) fn reach_late_readers(&self) -> Result<(), RuntimeError> {
        use iceoryx2::port::update_connections::UpdateConnections;
        self.publisher
            .update_connections()
            .map_err(|e| self.failed("reaching late readers", format!("{e:?}")))
    }

    /// Consumers connected at this time.
    pub fn consumers(&self) -> usize {
        use iceoryx2::prelude::PortFactory;
        self.service.dynamic_config().number_of_subscribers()
    }

    /// Payload bytes of everything sent.
    pub fn bytes_written(&self) -> u64 {
        self.bytes_written
    }

    fn failed(&self, action: &'static str, cause: String) -> RuntimeError {
        RuntimeError::Message {
            topic: self.name.clone(),
            action,
            cause,
        }
    }
}

/// A message being written, in shared memory. Dropped without [`Loan::publish`], it was never sent.
pub struct Loan<'a, T: Pod + Debug + ZeroCopySend> {
    sample: SampleMut<Ipc, [T], FrameHeader>,
    output: &'a mut Output<T>,
}

impl<T: Pod + Debug + ZeroCopySend> Loan<'_, T> {
    /// The message's header.
    pub fn header_mut(&mut self) -> &mut FrameHeader {
        self.sample.user_header_mut()
    }

    /// The message's elements.
    pub fn elements_mut(&mut self) -> &mut [T] {
        self.sample.payload_mut()
    }

    /// Sends it and wakes the consumers.
    pub fn publish(self) -> Result<(), RuntimeError> {
        let _span = tracing::trace_span!(target: "mluc::frame", "publish").entered();
        self.output.bytes_written += size_of_val(self.sample.payload()) as u64;
        self.sample
            .send()
            .map_err(|e| self.output.failed("sending", format!("{e:?}")))?;
        // The message is there already; a consumer that cannot be woken finds it at its next look.
        if let Err(error) = self.output.notifier.notify() {
            tracing::debug!(?error, topic = self.output.name, "waking the consumers");
        }
        Ok(())
    }
}

/// Writing to shared memory that is full kills the process by a signal: better said before.
fn check_room(topic: &Topic, name: &str, message_bytes: usize) -> Result<(), RuntimeError> {
    let needed = (topic.slots() * message_bytes) as u64;
    let Ok(about) = rustix::fs::statvfs(crate::instance::SHARED_MEMORY) else {
        return Ok(());
    };
    let free = about.f_bavail * about.f_frsize;
    if needed <= free {
        return Ok(());
    }
    Err(RuntimeError::SharedMemoryFull {
        topic: name.to_string(),
        needed_mib: needed.div_ceil(1 << 20),
        free_mib: free >> 20,
    })
}
