//! Temporal voting: unknown objects are followed over frames, and published once enough of the last frames saw them.
//!
//! A bush that looks like an object in one frame seldom does so in the next; a golf cart does. Known objects are not
//! looked at and never delayed.

use mluc_ipc_types::{Disposition, EgoPose, OBJECTS_MAX, Object, ObjectKind};
use serde::{Deserialize, Serialize};

use crate::{RefinerError, RefinerOutput};

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
        let (distance_m, window, hits) = (self.distance_max_m, self.window, self.confirm_hits);
        let is_distance = distance_m > 0.0 && distance_m.is_finite();
        let is_window = (1..=FRAMES_MAX).contains(&window);
        let (confirm, is_hits) = ("track.confirm_hits", (1..=window).contains(&hits));
        RefinerError::unless_all([
            ("track.distance_max_m", "above 0 m", distance_m, is_distance),
            ("track.window", "1 to 32 frames", window.into(), is_window),
            (confirm, "1 to track.window", hits.into(), is_hits),
        ])
    }
}

/// Most tracks at once; the oldest unseen one gives way.
const TRACKS_MAX: usize = 512;

/// Something unknown, seen in some of the last frames.
#[derive(Clone, Copy, Debug)]
struct Track {
    id: u32,
    /// Where it was seen last, m: in the fixed frame, or in the sensor's while no pose is known.
    place_m: [f64; 2],
    /// Metres a frame, from its last two sightings.
    step_m: [f64; 2],
    /// Frames since it was seen.
    unseen: u32,
    /// Which of the last frames saw it; bit 0 is the newest.
    seen: u32,
    is_confirmed: bool,
    /// An object of the frame in hand belongs to it already.
    is_taken: bool,
}

/// Follows unknown objects; buffers are made once, nothing grows beyond the settings.
#[derive(Debug)]
pub struct Tracker {
    settings: TrackSettings,
    tracks: Vec<Track>,
    order: Vec<usize>,
    next_id: u32,
    last_sequence: Option<u64>,
    had_pose: bool,
}

impl Tracker {
    /// Refuses settings that make no sense.
    pub fn new(settings: TrackSettings) -> Result<Tracker, RefinerError> {
        settings.check()?;
        Ok(Tracker {
            settings,
            tracks: Vec::with_capacity(TRACKS_MAX),
            order: Vec::with_capacity(OBJECTS_MAX),
            next_id: 0,
            last_sequence: None,
            had_pose: false,
        })
    }

    /// Unknown objects that are published get the number of their track; those that too few of the last frames saw
    /// become [`Disposition::Unconfirmed`]. Known objects stay as they are, and so do unknown ones beyond the most tracks.
    ///
    /// `ego`: the sensor's pose, where known; without it a moving sensor makes what stands still move. Frames that are
    /// missing between two calls count as frames that did not see anything.
    pub fn update(&mut self, sequence: u64, ego: &EgoPose, refined: &mut RefinerOutput) {
        self.age(sequence, ego.is_known == 1);
        let objects = &mut refined.objects;
        self.order.clear();
        self.order.extend((0..objects.len()).filter(|&index| {
            let object = &objects[index];
            object.kind == ObjectKind::Unknown as u32 && object.is_published()
        }));
        // The surest object chooses first; equal ones in their order.
        let score = |index: usize| objects[index].score;
        self.order.sort_by(|&a, &b| score(b).total_cmp(&score(a)));
        for place in 0..self.order.len() {
            let object = &mut objects[self.order[place]];
            let Some(track) = self.track_of(in_fixed_frame(ego, object.center_m)) else {
                continue;
            };
            object.track_id = track.id;
            if !track.is_confirmed {
                object.disposition = Disposition::Unconfirmed as u32;
            }
        }
    }

    /// Time passes; what was not seen for a whole window is forgotten.
    fn age(&mut self, sequence: u64, has_pose: bool) {
        let passed = match self.last_sequence {
            // Begun anew, or the frame of reference changed: nothing can be found again.
            Some(last) if sequence < last || has_pose != self.had_pose => u32::MAX,
            Some(last) => (sequence - last).min(u64::from(u32::MAX)) as u32,
            None => 0,
        };
        self.last_sequence = Some(sequence);
        self.had_pose = has_pose;
        let window = self.settings.window;
        let voting = u32::MAX >> (32 - window);
        self.tracks.retain_mut(|track| {
            track.seen = track.seen.checked_shl(passed).unwrap_or(0) & voting;
            track.unseen = track.unseen.saturating_add(passed);
            track.is_taken = false;
            track.seen != 0
        });
    }

    /// The free track nearest to where it should be now, or a new one; None when all tracks were seen in this frame.
    fn track_of(&mut self, place_m: [f64; 2]) -> Option<Track> {
        let tracks = self.tracks.iter().enumerate();
        let nearest = tracks
            .filter(|(_, track)| !track.is_taken)
            .map(|(index, track)| (index, track.distance_m(place_m)))
            .filter(|&(_, distance_m)| distance_m <= self.settings.distance_max_m)
            .min_by(|a, b| a.1.total_cmp(&b.1));
        let index = match nearest {
            Some((index, _)) => index,
            None => self.begin(place_m)?,
        };
        let confirm_hits = self.settings.confirm_hits;
        let track = &mut self.tracks[index];
        track.see(place_m);
        track.is_confirmed |= track.seen.count_ones() >= confirm_hits;
        Some(*track)
    }

    fn begin(&mut self, place_m: [f64; 2]) -> Option<usize> {
        if self.tracks.len() >= TRACKS_MAX {
            let stalest = (0..self.tracks.len())
                .filter(|&index| !self.tracks[index].is_taken)
                .max_by_key(|&index| self.tracks[index].unseen)?;
            self.tracks.remove(stalest);
        }
        self.tracks.push(Track {
            id: self.next_id,
            place_m,
            step_m: [0.0; 2],
            unseen: 0,
            seen: 0,
            is_confirmed: false,
            is_taken: false,
        });
        // Half of the numbers would last 6 years at 10 Hz; NONE is never given.
        self.next_id = (self.next_id + 1) % Object::NONE;
        Some(self.tracks.len() - 1)
    }
}

impl Track {
    fn distance_m(&self, place_m: [f64; 2]) -> f64 {
        let frames = f64::from(self.unseen);
        let away = |axis: usize| place_m[axis] - self.place_m[axis] - frames * self.step_m[axis];
        away(0).hypot(away(1))
    }

    fn see(&mut self, place_m: [f64; 2]) {
        if self.seen != 0 && self.unseen > 0 {
            let frames = f64::from(self.unseen);
            let step = |axis: usize| (place_m[axis] - self.place_m[axis]) / frames;
            // Half of the new step, half of the old: a box's centre jumps when another face comes into view.
            self.step_m = [0, 1].map(|axis| 0.5 * (self.step_m[axis] + step(axis)));
        }
        self.place_m = place_m;
        self.unseen = 0;
        self.seen |= 1;
        self.is_taken = true;
    }
}

/// From the sensor's frame into the one that stands still, seen from above; as it is while no pose is known.
fn in_fixed_frame(ego: &EgoPose, center_m: [f32; 3]) -> [f64; 2] {
    let [x, y] = [f64::from(center_m[0]), f64::from(center_m[1])];
    if ego.is_known != 1 {
        return [x, y];
    }
    let (sin, cos) = ego.yaw_rad.sin_cos();
    [
        ego.position_m[0] + x * cos - y * sin,
        ego.position_m[1] + x * sin + y * cos,
    ]
}
