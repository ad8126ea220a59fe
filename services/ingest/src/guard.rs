//! Checks that the input fits the model and the given sensor. "No boxes and no error" is the commonest complaint about
//! detectors; it has few causes, and scans show most of them.

mod judge;
mod reason;
#[cfg(test)]
mod tests;

use crate::{DecodeReport, estimate::Estimator};
pub use judge::Expected;
use mluc_ipc_types::Point;
pub use reason::Reason;

/// How long a place may contradict unit and axes: three minutes at 10 Hz; a guess.
const EXCUSED_LOOKS: u32 = 300;
/// The source is frozen after this number of equal scans in a row.
const FROZEN_MIN: u32 = 4;
/// Sampled points that decide whether a scan equals the one before.
const FROZEN_SAMPLE: usize = 256;
/// Number of first scans that all get a look, and the interval of later looks, in scans. On average a scan costs about 1 ms.
const LOOK_FIRST: u64 = 3;
const LOOK_EVERY: u64 = 6;
/// Number of last looks that vote on a reason.
const LOOKS: usize = 3;
/// The most reasons per scan.
const REASONS_MAX: usize = 24;

/// Looks at the first three scans, then at every sixth. A reason holds until the next look if two of the last three looks found it, or the
/// first look of all; reasons with one flag vote together.
#[derive(Clone, Debug)]
pub struct Guard {
    expected: Expected,
    estimator: Estimator,
    scans: u64,
    /// Reasons that the last looks found, the newest last.
    found: [Vec<Reason>; LOOKS],
    reasons: Vec<Reason>,
    last_scan: u64,
    equal_scans: u32,
    /// Looks left in which a doubt about feet or axes is put down to the place (a bridge, a lift), because a sound scan came before.
    excused: u32,
}

impl Guard {
    /// Allocates all memory.
    pub fn new(expected: Expected) -> Guard {
        Guard {
            expected,
            estimator: Estimator::new(),
            scans: 0,
            found: std::array::from_fn(|_| Vec::with_capacity(REASONS_MAX)),
            reasons: Vec::with_capacity(REASONS_MAX + 1),
            last_scan: 0,
            equal_scans: 0,
            excused: 0,
        }
    }

    /// Whether the next scan gets a look that can wait until the frame is sent. The verdicts on the first scans go out with their frames.
    pub fn looks_later(&self) -> bool {
        self.scans >= LOOK_FIRST && self.scans.is_multiple_of(LOOK_EVERY)
    }

    /// Checks the next scan, given its finite points, and returns what does not fit.
    pub fn check(&mut self, points: &[Point], report: &DecodeReport) -> &[Reason] {
        if self.scans < LOOK_FIRST || self.scans.is_multiple_of(LOOK_EVERY) {
            self.look(points, report.dropped_not_finite);
        }
        self.count_equal(points);
        self.scans += 1;
        self.reasons.retain(|r| !matches!(r, Reason::Frozen(_)));
        if self.equal_scans + 1 >= FROZEN_MIN {
            self.reasons.push(Reason::Frozen(self.equal_scans + 1));
        }
        &self.reasons
    }

    fn look(&mut self, points: &[Point], not_finite: u32) {
        self.found.rotate_left(1);
        let [before @ .., newest] = &mut self.found;
        newest.clear();
        self.estimator.clear();
        self.estimator.look(points, not_finite);
        let found = self.estimator.estimate();
        self.expected.judge(found, newest);
        let is_sound = found.height_m.is_some() && newest.is_empty();
        let left = if is_sound { EXCUSED_LOOKS } else { self.excused };
        self.excused = left.saturating_sub(1);
        for reason in newest.iter_mut().filter(|_| left > 0) {
            *reason = match *reason {
                Reason::Feet(found_m, takes_m) => Reason::Height(found_m, takes_m),
                Reason::Axes(_) => Reason::Tilt(90.0, self.expected.takes.tilt_max_deg),
                other => other,
            };
        }
        let is_first = self.scans == 0;
        self.reasons.clear();
        for (number, reason) in newest.iter().chain(before.iter().flatten()).enumerate() {
            let has_flag = |found: &&Vec<Reason>| found.iter().any(|r| r.flag() == reason.flag());
            let votes = before.iter().filter(has_flag).count() + usize::from(has_flag(&&*newest));
            let is_new =
                number < newest.len() || !self.reasons.iter().any(|r| r.flag() == reason.flag());
            if is_new && (votes >= 2 || is_first) && self.reasons.len() < REASONS_MAX {
                self.reasons.push(*reason);
            }
        }
    }

    /// Counts scans in a row whose sampled points lie at the same places. Empty scans do not count.
    fn count_equal(&mut self, points: &[Point]) {
        let step = (points.len() / FROZEN_SAMPLE).max(1);
        let mut sum = points.len() as u64;
        for point in points.iter().step_by(step) {
            for value in [point.x_m, point.y_m, point.z_m] {
                sum = (sum ^ u64::from(value.to_bits())).wrapping_mul(0x0000_0100_0000_01b3);
            }
        }
        let is_equal = sum == self.last_scan && !points.is_empty();
        self.equal_scans = if is_equal { self.equal_scans + 1 } else { 0 };
        self.last_scan = sum;
    }
}
