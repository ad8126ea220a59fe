//! The producer's end of a topic.

use crate::error::{Result, refusal};
use crate::node::{DataService, IpcNode, WakeService};
use crate::{Instance, Ipc, Payload, RuntimeError, instance::SHARED_MEMORY};
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::{AllocationStrategy, BackpressureStrategy, PortFactory};
use iceoryx2::{port::notifier::Notifier, port::publisher::Publisher, sample_mut::SampleMut};
use mluc_ipc_types::{FrameHeader, Topic};

/// Lends memory of a topic, sends it, and wakes the consumers that wait for it.
pub struct Output<T: Payload> {
    publisher: Publisher<Ipc, [T], FrameHeader>,
    notifier: Notifier<Ipc>,
    service: DataService<T>,
    _wake: WakeService,
    instance: Instance,
    name: String,
}

impl<T: Payload> Output<T> {
    /// `elements_max`: the largest message; the pool has [`Topic::slots`] times that.
    pub(crate) fn open(
        node: &IpcNode,
        topic: &Topic,
        name: &str,
        elements_max: usize,
    ) -> Result<Output<T>> {
        let failed = |cause: String| RuntimeError::topic(node.instance.name(), name, cause);
        check_room((topic.slots() * elements_max * size_of::<T>()) as u64).map_err(failed)?;
        let service = node.open_data::<T>(topic, name)?;
        let wake = node.open_wake(topic, name)?;
        let publisher = service
            .publisher_builder()
            .initial_max_slice_len(elements_max.max(1))
            .allocation_strategy(AllocationStrategy::Static)
            .max_loaned_samples(topic.loans)
            // This case never occurs while overflow is on; the default would wait for ever for a killed consumer.
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .create()
            .map_err(|e| failed(refusal("producer", &format!("{e:?}"))))?;
        let notifier = wake.notifier_builder().create();
        Ok(Output {
            publisher,
            notifier: notifier.map_err(|e| failed(format!("{e:?}")))?,
            service,
            _wake: wake,
            instance: node.instance.clone(),
            name: name.to_string(),
        })
    }

    /// Memory for a message of `elements` elements, to be filled in place. Its initial content is arbitrary.
    pub fn loan(&mut self, header: &FrameHeader, elements: usize) -> Result<Loan<'_, T>> {
        let sample = self.publisher.loan_slice_uninit(elements);
        let sample = sample.map_err(|e| self.failed("lending memory for a message", e))?;
        #[allow(unsafe_code)]
        // SAFETY: the memory is a mapped segment, whose bytes are all initialised (by the kernel to 0, or by an earlier
        // message), and `T: Pod` takes every bit pattern.
        let mut sample = unsafe { sample.assume_init() };
        *sample.user_header_mut() = *header;
        Ok(Loan { sample, output: self })
    }

    /// Sends a message with a copy of these elements.
    pub fn send(&mut self, header: &FrameHeader, elements: &[T]) -> Result<()> {
        let mut loan = self.loan(header, elements.len())?;
        loan.elements_mut().copy_from_slice(elements);
        loan.publish()
    }

    /// Connects consumers that joined since the last message. They get the messages of the topic's history.
    pub fn reach_late_readers(&self) -> Result<()> {
        self.publisher.update_connections().map_err(|e| self.failed("reaching late readers", e))
    }

    /// Number of consumers connected at this time, including killed ones that were not cleaned up.
    pub fn consumers(&self) -> usize {
        self.service.dynamic_config().number_of_subscribers()
    }

    fn failed(&self, action: &str, cause: impl std::fmt::Debug) -> RuntimeError {
        let cause = format!("{action}: {cause:?}");
        RuntimeError::topic(self.instance.name(), &self.name, cause)
    }
}

/// A message that is being written in shared memory. If it is dropped without [`Loan::publish`], it is not sent.
pub struct Loan<'a, T: Payload> {
    sample: SampleMut<Ipc, [T], FrameHeader>,
    output: &'a mut Output<T>,
}

impl<T: Payload> Loan<'_, T> {
    /// The message's header.
    pub fn header_mut(&mut self) -> &mut FrameHeader {
        self.sample.user_header_mut()
    }

    /// The message's elements.
    pub fn elements_mut(&mut self) -> &mut [T] {
        self.sample.payload_mut()
    }

    /// Sends it and wakes the consumers.
    pub fn publish(self) -> Result<()> {
        let sent = self.sample.send();
        sent.map_err(|e| self.output.failed("sending", e))?;
        // The message is sent already; a consumer that cannot be woken finds it at its next poll.
        if let Err(error) = self.output.notifier.notify() {
            tracing::debug!(?error, topic = self.output.name, "waking the consumers");
        }
        Ok(())
    }
}

/// Checks the free space in advance: a write to full shared memory kills the process by a signal.
fn check_room(needed: u64) -> std::result::Result<(), String> {
    let Ok(about) = rustix::fs::statvfs(SHARED_MEMORY) else {
        return Ok(());
    };
    let free = about.f_bavail * about.f_frsize;
    // A tmpfs without a limit has no blocks.
    if needed <= free || about.f_blocks == 0 {
        return Ok(());
    }
    Err(format!(
        "needs {} MiB of shared memory, {SHARED_MEMORY} has {} MiB free: make it larger (in a container: --shm-size; `mluc doctor` says how much all topics need)",
        needed.div_ceil(1 << 20),
        free >> 20
    ))
}
