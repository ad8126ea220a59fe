//! Computes series of figures from frame records.

use super::frame::{FrameRecord, STAGES, micros};

/// A stage that published this long before its next input is idle: its work after a frame (a heartbeat, sometimes
/// a check of its mappings) is over by then. That work was measured: below 1 ms.
const IDLE_NS: i64 = 2_000_000;

/// Figures of all frames given, in their order; see the module's terms.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Series {
    /// Latency of every frame, dropped frames included.
    pub(crate) latency_us: Vec<f64>,
    /// For every frame: 1 if it was dropped, else 0.
    pub(crate) is_dropped: Vec<f64>,
    pub(crate) delivered_us: Vec<f64>,
    pub(crate) queue_us: [Vec<f64>; 4],
    pub(crate) run_us: [Vec<f64>; 4],
    /// By topic, only for frames whose consumer was idle.
    pub(crate) hand_over_us: [Vec<f64>; 4],
    /// Sum of a frame's hand-overs, only for frames where every consumer was idle.
    pub(crate) hops_together_us: Vec<f64>,
    /// Dropped frames at the end that no newer objects followed: their latency is a lower bound.
    pub(crate) unanswered: usize,
}

/// The series of `frames`, which are in the order of rounds and sequences.
pub(crate) fn series(frames: &[FrameRecord]) -> Series {
    let (latency_us, unanswered) = latencies(frames);
    let is_dropped = |frame: &FrameRecord| f64::from(u8::from(!frame.is_out()));
    let mut series = Series {
        latency_us,
        is_dropped: frames.iter().map(is_dropped).collect(),
        unanswered,
        ..Series::default()
    };
    for (index, frame) in frames.iter().enumerate() {
        series.delivered_us.extend(frame.delivered_us());
        for stage in 0..STAGES.len() {
            series.queue_us[stage].extend(frame.queue_us(stage));
            series.run_us[stage].extend(frame.run_us(stage));
        }
        let before = index.checked_sub(1).map(|before| &frames[before]);
        let hand_overs = hand_overs(frame, before);
        for (all, hand_over) in series.hand_over_us.iter_mut().zip(hand_overs) {
            all.extend(hand_over);
        }
        let together: Option<f64> = hand_overs.into_iter().sum();
        series.hops_together_us.extend(together);
    }
    series
}

/// Latency of each frame: time from due until its objects, or a newer frame's objects, were out. Second: the number of unanswered frames.
fn latencies(frames: &[FrameRecord]) -> (Vec<f64>, usize) {
    let mut latency_us = vec![0.0; frames.len()];
    let mut unanswered = 0;
    let mut answer: Option<(u32, i64)> = None;
    for (index, frame) in frames.iter().enumerate().rev() {
        if let Some(published_ns) = frame.published_ns() {
            answer = Some((frame.round, published_ns));
        }
        let answered_ns = match answer {
            Some((round, ns)) if round == frame.round => ns,
            _ => {
                unanswered += 1;
                end_ns(frames, frame.round)
            }
        };
        latency_us[index] = micros(answered_ns - frame.due_ns);
    }
    (latency_us, unanswered)
}

/// The last known time of a round, ns.
fn end_ns(frames: &[FrameRecord], round: u32) -> i64 {
    let of_round = frames.iter().filter(|frame| frame.round == round);
    of_round.map(|frame| frame.due_ns.max(frame.arrived_ns)).max().unwrap_or(0)
}

/// Hand-overs by topic, us. `None`: the consumer was busy, or this is not known because the frame before was dropped.
fn hand_overs(frame: &FrameRecord, before: Option<&FrameRecord>) -> [Option<f64>; 4] {
    let is_next = |before: &&FrameRecord| {
        before.round == frame.round && before.sequence + 1 == frame.sequence
    };
    let before = before.filter(is_next).and_then(|before| before.stamps);
    std::array::from_fn(|topic| {
        let stamps = frame.stamps?;
        let sent_ns = stamps[topic].published_ns;
        let Some(consumer) = stamps.get(topic + 1) else {
            // The consumer of the objects has no other work, so it is idle.
            return Some(micros(frame.arrived_ns - sent_ns));
        };
        let is_idle = before?[topic + 1].published_ns + IDLE_NS < sent_ns;
        is_idle.then(|| micros(consumer.received_ns - sent_ns))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::frame::testing::{dropped, frame};

    #[test]
    fn a_frame_that_was_overtaken_counts_until_the_newer_one_is_out() {
        let frames = vec![frame(0, 1000), dropped(1), dropped(2), frame(3, 1000)];
        let series = series(&frames);
        // 4 stages of 1 ms and 10 us of hand-over each.
        assert_eq!(series.latency_us, [4040.0, 204_040.0, 104_040.0, 4040.0]);
        assert_eq!(series.delivered_us, [4040.0, 4040.0]);
        assert_eq!(series.unanswered, 0);
    }

    #[test]
    fn frames_that_nothing_follows_are_told_and_count_to_the_end() {
        let mut frames = vec![frame(0, 1000), dropped(1)];
        let later = [frame(0, 1000), dropped(1), dropped(2)];
        frames.extend(later.map(|frame| FrameRecord { round: 1, ..frame }));
        let series = series(&frames);
        assert_eq!(series.unanswered, 3);
        assert_eq!(series.latency_us, [4040.0, 0.0, 4040.0, 100_000.0, 0.0]);
    }

    #[test]
    fn queue_run_and_hand_over_are_told_apart() {
        let mut frames = vec![frame(0, 1000), frame(1, 1000)];
        frames[1].stamps.as_mut().unwrap()[1].started_ns += 5000;
        let figures = series(&frames);
        assert_eq!(figures.queue_us[1], [10.0, 15.0]);
        assert_eq!(figures.run_us[1], [1000.0, 995.0]);
        // Of the first frame nobody knows whether the stages were waiting.
        assert_eq!(figures.hand_over_us[0], [10.0]);
        assert_eq!(figures.hand_over_us[3], [20.0, 20.0]);
        assert_eq!(figures.hops_together_us, [50.0]);
    }

    #[test]
    fn a_busy_consumer_makes_no_hand_over() {
        // Each frame takes longer than a period in the backbone.
        let mut frames = vec![frame(0, 1000), frame(1, 1000)];
        frames[0].stamps.as_mut().unwrap()[1].published_ns = 101_500_000;
        let figures = series(&frames);
        assert!(figures.hand_over_us[0].is_empty());
        assert_eq!(figures.hand_over_us[1].len(), 1);
        assert!(figures.hops_together_us.is_empty());
    }
}
