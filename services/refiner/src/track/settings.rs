//! How unknown objects are followed.

use serde::{Deserialize, Serialize};

use crate::RefinerError;

/// Most frames that a track remembers: a bit each.
const FRAMES_MAX: u32 = 32;

/// Settings of the [`crate::Tracker`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TrackSettings {
    /// Farthest that an object's centre may be, seen from above, from where its track expects it, m. A golf cart at
    /// 15 km/h, whose speed is not known yet, moves 0.4 m in a frame at 10 Hz; the rest is how a box's centre wanders
    /// when other faces come into view.
    pub distance_max_m: f64,
    /// Frames that must have seen an object, among the last `window`, before it is published.
    pub confirm_hits: u32,
    /// Frames that vote, at most 32. Two of three costs one frame of delay (100 ms at 10 Hz) and bridges one miss.
    pub window: u32,
}

impl Default for TrackSettings {
    fn default() -> TrackSettings {
        TrackSettings {
            distance_max_m: 1.5,
            confirm_hits: 2,
            window: 3,
        }
    }
}

impl TrackSettings {
    /// Errors: a distance that is not above 0, votes that cannot be reached.
    pub fn check(&self) -> Result<(), RefinerError> {
        let wrong = |name, expected, found| {
            Err(RefinerError::Setting {
                name,
                expected,
                found,
            })
        };
        if !(self.distance_max_m > 0.0 && self.distance_max_m.is_finite()) {
            return wrong("track.distance_max_m", "above 0 m", self.distance_max_m);
        }
        if !(1..=FRAMES_MAX).contains(&self.window) {
            return wrong("track.window", "1 to 32 frames", f64::from(self.window));
        }
        if !(1..=self.window).contains(&self.confirm_hits) {
            let found = f64::from(self.confirm_hits);
            return wrong("track.confirm_hits", "1 to track.window", found);
        }
        Ok(())
    }
}
