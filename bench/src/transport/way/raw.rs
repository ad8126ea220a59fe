//! iceoryx2 alone: the stages' services, header and elements, and nothing of ours around them.

use std::time::Instant;

use anyhow::{Context, Result, bail};
use iceoryx2::prelude::{AllocationStrategy, BackpressureStrategy};
use mluc_runtime::{Payload, Shell, Shutdown, monotonic_ns};

use super::{
    Arrived, Link, PATIENCE, Receiver, Sender, Sent, Way, element_of, read, silence, sum_of,
};

/// A process's place among the others. Drop it last: the last one removes all files.
fn join(link: &Link) -> Result<Shell> {
    let instance = link.instance(Way::Raw)?;
    Ok(Shell::observer(&instance, None, Shutdown::manual())?)
}

pub(super) fn sender<T: Payload>(link: &Link) -> Result<Sender> {
    let (shell, topic, elements) = (join(link)?, link.payload.topic(), link.elements);
    let (data, wake) = shell.services::<T>(topic)?;
    let publisher = data
        .publisher_builder()
        .initial_max_slice_len(elements)
        .allocation_strategy(AllocationStrategy::Static)
        .max_loaned_samples(topic.loans)
        .backpressure_strategy(BackpressureStrategy::DiscardData)
        .create()
        .context("making a publisher")?;
    let notifier = wake.notifier_builder().create();
    let notifier = notifier.context("making a notifier")?;
    let end = (publisher, notifier, shell);
    Ok(Box::new(move |word| {
        let (publisher, notifier, _) = &end;
        let sample = publisher.loan_slice_uninit(elements);
        let sample = sample.context("lending memory")?;
        let element = element_of(word);
        let mut sample = sample.write_from_fn(|_| element);
        let at_ns = monotonic_ns();
        sample.user_header_mut().stages[0].published_ns = at_ns;
        sample.send().context("sending")?;
        notifier.notify().context("waking")?;
        Ok(Sent {
            at_ns,
            sum: sum_of::<T>(word, elements),
        })
    }))
}

pub(super) fn receiver<T: Payload>(link: &Link) -> Result<Receiver> {
    let shell = join(link)?;
    let (data, wake) = shell.services::<T>(link.payload.topic())?;
    let subscriber = data.subscriber_builder().create();
    let subscriber = subscriber.context("making a subscriber")?;
    let listener = wake.listener_builder().create();
    let listener = listener.context("making a listener")?;
    let end = (subscriber, listener, shell);
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
            // A wake-up of a message that is taken already ends this early: then it looks again.
            let waited = listener.timed_wait(|_| (), PATIENCE);
            waited.context("waiting")?;
        }
        bail!(silence(Way::Raw))
    }))
}
