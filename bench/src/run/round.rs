//! From the arrivals of one start of the processes to the record of every frame that was due.

use mluc_ipc_types::{Flags, FrameHeader};

use super::pipeline::Arrival;
use crate::report::{FrameRecord, Stamps};

/// Which frames were due when.
pub(crate) struct Clock {
    pub(crate) round: u32,
    pub(crate) rate_hz: f64,
    pub(crate) warm_up_s: f64,
}

impl Clock {
    /// Every frame of a round, `frames_in` of them; those that never arrived were due at the rate.
    pub(crate) fn frames(&self, arrivals: &[Arrival], frames_in: u64) -> Vec<FrameRecord> {
        let period_ns = 1e9 / self.rate_hz;
        let Some(first) = arrivals.first() else {
            return (0..frames_in)
                .map(|sequence| self.dropped(sequence, (sequence as f64 * period_ns) as i64))
                .collect();
        };
        let zero_ns = due_ns(&first.header) - (first.header.sequence as f64 * period_ns) as i64;
        let mut arrivals = arrivals.iter().peekable();
        // A restarted ingest begins another count of periods: the last frame seen is the reference.
        let (mut seen, mut seen_due_ns) = (0u64, 0i64);
        (0..frames_in)
            .map(|sequence| {
                let found = arrivals.next_if(|arrival| arrival.header.sequence == sequence);
                match found {
                    Some(arrival) => {
                        let frame = self.out(arrival, zero_ns);
                        (seen, seen_due_ns) = (sequence, frame.due_ns);
                        frame
                    }
                    None => self.dropped(
                        sequence,
                        seen_due_ns + ((sequence - seen) as f64 * period_ns) as i64,
                    ),
                }
            })
            .collect()
    }

    fn is_warm_up(&self, due_ns: i64) -> bool {
        (due_ns as f64) < self.warm_up_s * 1e9
    }

    fn dropped(&self, sequence: u64, due_ns: i64) -> FrameRecord {
        FrameRecord {
            round: self.round,
            sequence,
            is_warm_up: self.is_warm_up(due_ns),
            due_ns,
            ..FrameRecord::default()
        }
    }

    fn out(&self, arrival: &Arrival, zero_ns: i64) -> FrameRecord {
        let header = &arrival.header;
        let due_ns = due_ns(header) - zero_ns;
        // A stamp that a stage left out stays where the frame was due, and shows as no time at all.
        let since = |ns: u64| if ns == 0 { due_ns } else { ns as i64 - zero_ns };
        let stamps = header.stages.map(|stage| Stamps {
            received_ns: since(stage.received_ns),
            started_ns: since(stage.started_ns),
            published_ns: since(stage.published_ns),
        });
        let flags: Vec<&str> = Flags(header.flags).names().collect();
        FrameRecord {
            round: self.round,
            sequence: header.sequence,
            name: header.name().to_string(),
            is_warm_up: self.is_warm_up(due_ns),
            due_ns,
            stamps: Some(stamps),
            arrived_ns: arrival.at_ns as i64 - zero_ns,
            flags: flags.join(" "),
        }
    }
}

fn due_ns(header: &FrameHeader) -> i64 {
    header.stages[0].received_ns as i64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn arrival(sequence: u64, due_ms: u64) -> Arrival {
        let mut header = FrameHeader::new(sequence, "a");
        header.stages[0].received_ns = due_ms * 1_000_000;
        header.stages[3].published_ns = (due_ms + 30) * 1_000_000;
        Arrival {
            header,
            at_ns: (due_ms + 31) * 1_000_000,
        }
    }

    #[test]
    fn frames_that_never_came_were_due_all_the_same() {
        let clock = Clock {
            round: 2,
            rate_hz: 10.0,
            warm_up_s: 0.15,
        };
        // The first frame, two in the middle and the last are missing; ingest was restarted 40 ms late.
        let arrivals = [arrival(1, 5100), arrival(4, 5440)];
        let frames = clock.frames(&arrivals, 6);
        let due_ms: Vec<i64> = frames
            .iter()
            .map(|frame| frame.due_ns / 1_000_000)
            .collect();
        assert_eq!(due_ms, [0, 100, 200, 300, 440, 540]);
        let out: Vec<bool> = frames.iter().map(FrameRecord::is_out).collect();
        assert_eq!(out, [false, true, false, false, true, false]);
        let warm: Vec<bool> = frames.iter().map(|frame| frame.is_warm_up).collect();
        assert_eq!(warm, [true, true, false, false, false, false]);
        assert_eq!(frames[4].published_ns(), Some(470_000_000));
        assert_eq!((frames[4].arrived_ns, frames[4].round), (471_000_000, 2));
        assert_eq!(
            frames[4].run_us(1),
            Some(0.0),
            "stamps that are not there show no time"
        );
    }

    #[test]
    fn a_round_without_any_frame_has_only_dropped_ones() {
        let clock = Clock {
            round: 0,
            rate_hz: 4.0,
            warm_up_s: 0.0,
        };
        let frames = clock.frames(&[], 3);
        assert_eq!(frames[2].due_ns, 500_000_000);
        assert!(frames.iter().all(|frame| !frame.is_out()));
    }
}
