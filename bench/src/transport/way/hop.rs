//! The stages' own way: loan, publish, next, as every stage does it.

use std::time::Instant;

use anyhow::{Context, Result};
use mluc_ipc_types::{FrameHeader, Stage};
use mluc_runtime::{Payload, Shell, Shutdown, monotonic_ns};

use super::{
    Arrived, Link, PATIENCE, Receiver, Sender, Sent, Way, element_of, read, silence, sum_of,
};

pub(super) fn sender<T: Payload>(link: &Link) -> Result<Sender> {
    let elements = link.elements;
    let instance = link.instance(Way::Hop)?;
    let mut shell = Shell::stage(&instance, Stage::Ingest, Shutdown::manual())?;
    let output = shell.output::<T>(link.payload.topic(), elements)?;
    // The shell is dropped last.
    let mut end = (output, shell);
    let mut sequence = 0;
    Ok(Box::new(move |word| {
        let (output, shell) = &mut end;
        let header = FrameHeader::new(sequence, "bench");
        sequence += 1;
        let mut loan = output.loan(&header, elements)?;
        // Element by element, as raw iceoryx2 fills its memory.
        let element = element_of(word);
        for to in loan.elements_mut() {
            *to = element;
        }
        let at_ns = monotonic_ns();
        loan.header_mut().stamps_mut(Stage::Ingest).published_ns = at_ns;
        loan.publish()?;
        shell.tick()?;
        Ok(Sent {
            at_ns,
            sum: sum_of::<T>(word, elements),
        })
    }))
}

pub(super) fn receiver<T: Payload>(link: &Link) -> Result<Receiver> {
    let instance = link.instance(Way::Hop)?;
    let shutdown = Shutdown::manual();
    let shell = Shell::stage(&instance, Stage::Backbone, shutdown.clone())?;
    let input = shell.input::<T>(link.payload.topic())?;
    let mut end = (input, shell);
    Ok(Box::new(move || {
        let (input, shell) = &mut end;
        let begun = Instant::now();
        let message = shell.next(input, |_| {
            if begun.elapsed() > PATIENCE {
                shutdown.request();
            }
            Ok(())
        })?;
        let message = message.with_context(|| silence(Way::Hop))?;
        Ok(Arrived {
            at_ns: message.received_ns,
            sum: read(message.elements()),
        })
    }))
}
