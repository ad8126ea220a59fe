//! Turns the arrivals of one start of the processes into the record of every frame that was due.

use super::pipeline::Arrival;
use crate::report::{FrameRecord, Stamps};
use mluc_ipc_types::{Flags, FrameHeader};

/// All `frames_in` frames of a round. The rate gives the due time of a frame that never arrived.
pub(crate) fn frames(
    round: u32,
    (rate_hz, warm_up_s): (f64, f64),
    (arrivals, frames_in): (&[Arrival], u64),
) -> Vec<FrameRecord> {
    let periods_ns = |count: u64| (count as f64 * 1e9 / rate_hz) as i64;
    let first = arrivals.first().map(|arrival| &arrival.header);
    let zero_ns = first.map_or(0, |first| due_ns(first) - periods_ns(first.sequence));
    let mut arrivals = arrivals.iter().peekable();
    // A restarted ingest counts its periods anew: the last frame seen is the reference.
    let (mut seen, mut seen_due_ns) = (0, 0);
    let frame = |sequence| {
        let mut frame = FrameRecord {
            round,
            sequence,
            due_ns: seen_due_ns + periods_ns(sequence - seen),
            ..FrameRecord::default()
        };
        if let Some(arrival) = arrivals.next_if(|found| found.header.sequence == sequence) {
            came_out(&mut frame, arrival, zero_ns);
            (seen, seen_due_ns) = (sequence, frame.due_ns);
        }
        frame.is_warm_up = (frame.due_ns as f64) < warm_up_s * 1e9;
        frame
    };
    (0..frames_in).map(frame).collect()
}

fn came_out(frame: &mut FrameRecord, arrival: &Arrival, zero_ns: i64) {
    let header = &arrival.header;
    frame.due_ns = due_ns(header) - zero_ns;
    // A stamp that a stage left out gets the frame's due time and so adds no time.
    let since = |ns: u64| match ns {
        0 => frame.due_ns,
        ns => ns as i64 - zero_ns,
    };
    frame.stamps = Some(header.stages.map(|stage| Stamps {
        received_ns: since(stage.received_ns),
        started_ns: since(stage.started_ns),
        published_ns: since(stage.published_ns),
    }));
    frame.name = header.name().to_string();
    frame.arrived_ns = arrival.at_ns as i64 - zero_ns;
    frame.flags = Flags(header.flags).names().collect::<Vec<_>>().join(" ");
}

fn due_ns(header: &FrameHeader) -> i64 {
    header.stages[0].received_ns as i64
}
