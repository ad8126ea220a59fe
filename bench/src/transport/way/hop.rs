//! The stages' own way: loan, publish, next, as every stage does it.

use std::time::Instant;

use anyhow::Result;
use mluc_ipc_types::{FrameHeader, Stage};
use mluc_runtime::{Input, Output, Shell, Shutdown, monotonic_ns};

use super::{
    Arrived, Element, Link, PATIENCE, Receiver, Sender, Sent, Way, element_of, for_elements, read,
    silence, sum_of,
};

pub(super) fn sender(link: &Link) -> Result<Box<dyn Sender>> {
    for_elements!(link, sender_of)
}

pub(super) fn receiver(link: &Link) -> Result<Box<dyn Receiver>> {
    for_elements!(link, receiver_of)
}

fn sender_of<T: Element>(link: &Link) -> Result<Box<dyn Sender>> {
    let instance = link.instance(Way::Hop)?;
    let mut shell = Shell::stage(&instance, Stage::Ingest, Shutdown::manual())?;
    let output = shell.output::<T>(link.load.payload.topic(), link.load.elements())?;
    Ok(Box::new(HopSender {
        output,
        shell,
        elements: link.load.elements(),
        sequence: 0,
    }))
}

fn receiver_of<T: Element>(link: &Link) -> Result<Box<dyn Receiver>> {
    let instance = link.instance(Way::Hop)?;
    let shutdown = Shutdown::manual();
    let shell = Shell::stage(&instance, Stage::Backbone, shutdown.clone())?;
    let input = shell.input::<T>(link.load.payload.topic())?;
    Ok(Box::new(HopReceiver {
        input,
        shell,
        shutdown,
    }))
}

struct HopSender<T: Element> {
    output: Output<T>,
    shell: Shell,
    elements: usize,
    sequence: u64,
}

impl<T: Element> Sender for HopSender<T> {
    fn send(&mut self, word: u32) -> Result<Sent> {
        let header = FrameHeader::new(self.sequence, "bench");
        self.sequence += 1;
        let asked_ns = monotonic_ns();
        let mut loan = self.output.loan(&header, self.elements)?;
        let lent_ns = monotonic_ns();
        // Element by element, as raw iceoryx2 fills its memory.
        let element = element_of(word);
        for to in loan.elements_mut() {
            *to = element;
        }
        let at_ns = monotonic_ns();
        loan.header_mut().stamps_mut(Stage::Ingest).published_ns = at_ns;
        loan.publish()?;
        let occupied_ns = lent_ns - asked_ns + monotonic_ns() - at_ns;
        self.shell.tick()?;
        Ok(Sent {
            at_ns,
            occupied_ns,
            sum: sum_of::<T>(word, self.elements),
        })
    }
}

struct HopReceiver<T: Element> {
    input: Input<T>,
    shell: Shell,
    shutdown: Shutdown,
}

impl<T: Element> Receiver for HopReceiver<T> {
    fn receive(&mut self) -> Result<Arrived> {
        let begun = Instant::now();
        let shutdown = &self.shutdown;
        let message = self.shell.next(&mut self.input, |_| {
            if begun.elapsed() > PATIENCE {
                shutdown.request();
            }
            Ok(())
        })?;
        let message = message.ok_or_else(|| silence(Way::Hop))?;
        Ok(Arrived {
            at_ns: message.received_ns,
            sum: read(message.elements()),
        })
    }
}
