//! Azimuth between two columns: the most frequent distance between neighbouring returns along a beam.

use smart_default::SmartDefault;

/// The most returns per beam that are used.
const RETURNS_MAX: usize = 4096;
/// A beam with fewer returns gives no votes.
const RETURNS_MIN: usize = 60;
/// Histogram of distances, degrees.
const BIN_DEG: f32 = 0.01;
const BINS: usize = 150;

/// Collects the azimuths of one beam, and sums votes over beams and scans.
#[derive(Clone, Debug, SmartDefault)]
pub(super) struct StepVotes {
    #[default(Vec::with_capacity(RETURNS_MAX))]
    azimuths_deg: Vec<f32>,
    #[default([0; BINS])]
    votes: [u32; BINS],
}

impl StepVotes {
    pub(super) fn clear(&mut self) {
        self.azimuths_deg.clear();
        self.votes.fill(0);
    }

    /// Adds a return of the current beam.
    pub(super) fn add(&mut self, x_m: f32, y_m: f32) {
        if self.azimuths_deg.len() < RETURNS_MAX {
            self.azimuths_deg.push(y_m.atan2(x_m).to_degrees());
        }
    }

    /// Ends the beam: its neighbouring returns vote.
    pub(super) fn end_beam(&mut self) {
        if self.azimuths_deg.len() >= RETURNS_MIN {
            self.azimuths_deg.sort_unstable_by(f32::total_cmp);
            for pair in self.azimuths_deg.windows(2) {
                let bin = ((pair[1] - pair[0]) / BIN_DEG) as usize;
                // Two returns of the same column show no step.
                if (3..BINS).contains(&bin) {
                    self.votes[bin] += 1;
                }
            }
        }
        self.azimuths_deg.clear();
    }

    /// The step, degrees; `None` where too few returns voted.
    pub(super) fn step_deg(&self) -> Option<f32> {
        let sums = self.votes.windows(3).map(|three| three.iter().sum::<u32>()).enumerate();
        let (bin, most) = sums.max_by_key(|&(bin, sum)| (sum, BINS - bin))?;
        let three = [0, 1, 2].map(|i| (bin + i) as f32 + 0.5);
        let weighted: f32 = (0..3).map(|i| three[i] * self.votes[bin + i] as f32).sum();
        (most as usize >= RETURNS_MIN / 2).then(|| weighted / most as f32 * BIN_DEG)
    }
}
