//! Evidence over time: unknown objects are tracked over frames, and published when the last frames give enough evidence.
//!
//! A bush that looks like an object in one frame mostly does so in the next, because it stands still: more frames alone are little evidence.
//! An object that moves over the ground is no bush. So a track gets the mean log odds of its best frames, and more if it moves; a track that stands
//! still for a whole window is ranked lower, also before it is confirmed. A confirmed track stays confirmed. Known objects are never delayed.

use crate::{RefinerError, RefinerOutput};
use mluc_ipc_types::{
    Disposition, EgoPose, FrameHeader, OBJECTS_MAX, Object, ObjectKind, TrackNews,
};
use serde::{Deserialize, Serialize};
use smart_default::SmartDefault;

/// Maximum number of frames that a track remembers.
const FRAMES_MAX: usize = 32;
/// A track moves if its displacement over the ground within a window is at least this, m, and at least this share of its path.
const MOVED_MIN_M: f64 = 1.5;
const STRAIGHT_MIN: f64 = 0.9;
/// A track that was not seen for this many windows of sequence numbers is forgotten, even if few of these frames came.
const WINDOWS_MAX: u64 = 4;
/// After a longer step of the stamps, ns, and four times the one before it, no track is found again: the sensor was silent.
const SILENCE_MAX_NS: u64 = 4_000_000_000;
/// Maximum distance that an object seen once moves until the next frame, m: 40 m/s at 10 Hz.
const WAY_MAX_M: f64 = 4.0;
/// Maximum number of lost frames that widen the distance at which an object is searched.
const LOST_MAX: u64 = 2;
/// Log odds that are added for motion, and for standing still for a whole window: fitted to simulated validation drives, with a slope of
/// 1.0 on the mean of the best frames.
const MOVING: f64 = 2.0;
const STILL: f64 = -0.5;

/// Settings of the [`crate::Tracker`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, SmartDefault)]
#[serde(deny_unknown_fields, default)]
pub struct TrackSettings {
    /// Maximum distance, seen from above, of an object's centre from the place where its track expects it, m. A golf cart at 15 km/h, whose speed
    /// is not known yet, moves 0.4 m per frame at 10 Hz; the rest allows a box's centre to shift when other faces come into view.
    #[default(1.5)]
    pub distance_max_m: f64,
    /// Frames, of the last `window` that came, in which an object must be seen before it is published. As many of its best ones give its probability.
    #[default(5)]
    pub confirm_hits: u32,
    /// Number of frames that count, at most 32.
    #[default(10)]
    pub window: u32,
    /// Minimum probability of a confirmed track, 0 to 1; if the model gives no probabilities, the hits alone confirm a track.
    #[default(0.4)]
    pub probability_min: f64,
}

impl TrackSettings {
    /// Errors: a distance that is not above 0, a window not of 1 to 32 frames, hits that cannot be reached, a probability not within 0 to 1.
    pub fn check(&self) -> Result<(), RefinerError> {
        let (distance_m, window, hits) = (self.distance_max_m, self.window, self.confirm_hits);
        let is_distance = distance_m > 0.0 && distance_m.is_finite();
        let is_window = (1..=FRAMES_MAX as u32).contains(&window);
        let (least, probability) = ("track.probability_min", self.probability_min);
        let is_probability = (0.0..=1.0).contains(&probability);
        let (confirm, is_hits) = ("track.confirm_hits", (1..=window).contains(&hits));
        RefinerError::unless_all([
            ("track.distance_max_m", "above 0 m", distance_m, is_distance),
            ("track.window", "1 to 32 frames", window.into(), is_window),
            (confirm, "1 to track.window", hits.into(), is_hits),
            (least, "0 to 1", probability, is_probability),
        ])
    }
}

/// Maximum number of tracks; a new track replaces the one that was unseen for longest.
const TRACKS_MAX: usize = 512;

/// One frame's object of a track.
#[derive(Clone, Copy, Debug, Default)]
struct Sighting {
    sequence: u64,
    /// Number of the frame among the frames that came.
    frame: u64,
    stamp_ns: u64,
    /// Place, m: in the fixed frame, or in the sensor frame while no pose is known.
    place_m: [f64; 2],
    /// Log odds of being an object; infinite if the model gives no probabilities, NaN if only this frame gives none.
    log_odds: f64,
}

/// An unknown object that was seen in some of the last frames.
#[derive(Clone, Copy, Debug, Default)]
struct Track {
    id: u32,
    /// Its first frame, among the frames that came.
    first: u64,
    seen: [Sighting; FRAMES_MAX],
    /// Number of sightings in the window.
    count: usize,
    /// Motion per frame, m, from its last sightings. Until the second sighting, also the motion if another track saw the same object once.
    steps_m: [[f64; 2]; 2],
    news: TrackNews,
    probability: f64,
    /// Whether an object of the current frame belongs to it already.
    is_taken: bool,
}

/// Tracks unknown objects; buffers are allocated once, and nothing grows beyond the settings.
#[derive(Debug)]
pub struct Tracker {
    settings: TrackSettings,
    tracks: Vec<Track>,
    order: Vec<usize>,
    next_id: u32,
    /// Number of frames that came.
    frame: u64,
    /// Run, source of the sensor's pose ([`EgoPose::is_known`]), sequence and stamp (ns) of the last frame.
    last: Option<[u64; 4]>,
    /// The last step of the stamps, ns.
    step_ns: u64,
    /// The usual step: the last one, or two thirds of the one before that.
    period_ns: u64,
}

impl Tracker {
    /// Returns an error for invalid settings.
    pub fn new(settings: TrackSettings) -> Result<Tracker, RefinerError> {
        settings.check()?;
        Ok(Tracker {
            settings,
            tracks: Vec::with_capacity(TRACKS_MAX),
            order: Vec::with_capacity(OBJECTS_MAX),
            next_id: 0,
            frame: 0,
            last: None,
            step_ns: 0,
            period_ns: 0,
        })
    }

    /// Unsuppressed unknown objects, also with a low score, get number, age, speed and probability of their track. All of a confirmed track are
    /// published; others that would be become [`Disposition::Unconfirmed`]. Known objects, and unknown ones beyond the most tracks, stay the same.
    ///
    /// The header has the sensor's pose, if known; without it no track is known to move. Frames that are missing between two calls are no
    /// evidence, but a track that stays unseen for four windows is forgotten.
    pub fn update(&mut self, header: &FrameHeader, refined: &mut RefinerOutput) {
        let (told_by, stamp_ns) = (header.ego.is_known.into(), header.sensor_stamp_ns);
        self.age([header.run_id, told_by, header.sequence, stamp_ns]);
        let objects = &mut refined.objects;
        let is_low = |object: &Object| object.disposition == Disposition::LowScore as u32;
        self.order.clear();
        self.order.extend((0..objects.len()).filter(|&index| {
            let object = &objects[index];
            // An unrefined object may continue a confirmed track.
            let is_unrefined = object.flags & Object::UNREFINED != 0;
            let may_count = object.probability().is_some() || is_unrefined;
            object.kind == ObjectKind::Unknown as u32
                && (object.is_published() || is_low(object) && may_count)
        }));
        // The object with the highest score chooses first; equal scores keep their order.
        let score = |index: usize| objects[index].score;
        self.order.sort_by(|&a, &b| score(b).total_cmp(&score(a)));
        for place in 0..self.order.len() {
            let object = &mut objects[self.order[place]];
            let told = object.probability();
            let sighting = Sighting {
                sequence: header.sequence,
                stamp_ns: header.sensor_stamp_ns,
                place_m: in_fixed_frame(&header.ego, object.center_m),
                frame: self.frame,
                log_odds: match told {
                    Some(probability) => log_odds(probability),
                    None if object.flags & Object::UNREFINED != 0 => f64::NAN,
                    None => f64::INFINITY,
                },
            };
            let Some(track) = self.track_of(sighting, header.ego.is_known != 0) else {
                continue;
            };
            object.tell_track(track.id, track.news);
            if told.is_some() {
                object.tell_probability(track.probability as f32);
            }
            if track.news.is_confirmed {
                object.disposition = Disposition::Published as u32;
            } else if object.is_published() {
                object.disposition = Disposition::Unconfirmed as u32;
            }
        }
        self.guess();
    }

    /// Advances the time, and forgets tracks that were not seen for a whole window.
    fn age(&mut self, now @ [.., sequence, stamp_ns]: [u64; 4]) {
        // The run began anew, the frame of reference changed, or the sensor was silent: no track can be found again.
        let last = self.last.replace(now);
        let step_ns = last.map_or(0, |last| stamp_ns.abs_diff(last[3]));
        let was_silent = step_ns > SILENCE_MAX_NS.max(4 * self.step_ns);
        self.period_ns = self.step_ns.max(self.period_ns / 3 * 2);
        self.step_ns = step_ns.min(u64::MAX / 4);
        if was_silent || last.is_some_and(|last| now[..2] != last[..2] || sequence < last[2]) {
            self.tracks.clear();
        }
        match last {
            // The numbers differ from an earlier refiner's: a frame begins at most TRACKS_MAX tracks.
            None => {
                let first = sequence.wrapping_mul(TRACKS_MAX as u64);
                self.next_id = (first % u64::from(Object::NONE)) as u32;
            }
            Some([.., before, _]) => self.frame += u64::from(sequence != before),
        }
        let window = u64::from(self.settings.window);
        let oldest = self.frame.saturating_sub(window - 1);
        let earliest = sequence.saturating_sub(WINDOWS_MAX * window);
        self.tracks.retain_mut(|track| {
            track.is_taken = false;
            let seen = track.seen[..track.count].iter();
            let is_young = |one: &&Sighting| one.frame >= oldest && one.sequence >= earliest;
            track.count = seen.take_while(is_young).count();
            track.count > 0
        });
    }

    /// The free track that expects the sighting nearest to its place, or a new one, updated; `None` when all tracks were seen in this frame.
    fn track_of(&mut self, sighting: Sighting, has_pose: bool) -> Option<&Track> {
        let free = self.tracks.iter().enumerate().filter(|(_, t)| !t.is_taken);
        let distances = free.map(|(index, track)| (index, track.distance_m(&sighting).0));
        let near = distances.filter(|(index, m)| {
            // After lost frames the object may be farther away.
            let seen = &self.tracks[*index].seen[0];
            let frames = sighting.sequence - seen.sequence;
            let lost = frames - (sighting.frame - seen.frame);
            // What is lost before ingest has no number.
            let passed_ns = sighting.stamp_ns.saturating_sub(seen.stamp_ns);
            let periods = passed_ns.checked_div(self.period_ns).unwrap_or(0);
            let lost = lost.max(periods.saturating_sub(frames));
            *m <= self.settings.distance_max_m * (1 + lost.min(LOST_MAX)) as f64
        });
        let nearest = near.min_by(|a, b| a.1.total_cmp(&b.1));
        let index = match nearest {
            Some((index, _)) => index,
            None => self.begin(sighting.frame)?,
        };
        let track = &mut self.tracks[index];
        track.see(sighting);
        track.judge(&self.settings, has_pose);
        Some(track)
    }

    /// An object that moves too fast for its track begins a new one: it may be the nearest object that was seen once and is no longer there.
    fn guess(&mut self) {
        for index in 0..self.tracks.len() {
            let young = &self.tracks[index];
            if young.count > 1 || !young.is_taken {
                continue;
            }
            let gone = self.tracks.iter().filter(|t| t.count == 1 && !t.is_taken);
            let ways = gone.filter_map(|track| track.way_m(&young.seen[0]));
            let ways = ways.map(|[x, y]| (x.hypot(y), [x, y])).filter(|way| way.0 <= WAY_MAX_M);
            if let Some((_, way_m)) = ways.min_by(|a, b| a.0.total_cmp(&b.0)) {
                self.tracks[index].steps_m[1] = way_m;
            }
        }
    }

    fn begin(&mut self, first: u64) -> Option<usize> {
        if self.tracks.len() >= TRACKS_MAX {
            let free = (0..self.tracks.len()).filter(|&index| !self.tracks[index].is_taken);
            let stalest = free.min_by_key(|&index| self.tracks[index].seen[0].sequence)?;
            self.tracks.remove(stalest);
        }
        self.tracks.push(Track { id: self.next_id, first, ..Track::default() });
        // Half of the numbers would last 6 years at 10 Hz; NONE is never given.
        self.next_id = (self.next_id + 1) % Object::NONE;
        Some(self.tracks.len() - 1)
    }
}

impl Track {
    /// Motion per frame since the last sighting, m; `None` for the same frame.
    fn way_m(&self, to: &Sighting) -> Option<[f64; 2]> {
        let last = &self.seen[0];
        let frames = to.sequence.checked_sub(last.sequence);
        let frames = frames.filter(|frames| *frames > 0)?;
        Some([0, 1].map(|axis| (to.place_m[axis] - last.place_m[axis]) / frames as f64))
    }

    /// Distance from the expected place, m, by the step that leads nearer, and that step.
    fn distance_m(&self, to: &Sighting) -> (f64, [f64; 2]) {
        let last = &self.seen[0];
        let frames = (to.sequence - last.sequence) as f64;
        let [own, guess] = self.steps_m.map(|step_m| {
            let away = |axis| to.place_m[axis] - last.place_m[axis] - frames * step_m[axis];
            (f64::hypot(away(0), away(1)), step_m)
        });
        if guess.0 < own.0 { guess } else { own }
    }

    fn see(&mut self, sighting: Sighting) {
        let last = self.seen[0];
        let way_m = self.way_m(&sighting);
        if let (Some(way_m), true) = (way_m, self.count > 0) {
            let (_, old_m) = self.distance_m(&sighting);
            // The mean of the new and the old step: a box's centre jumps when another face comes into view.
            self.steps_m = [[0, 1].map(|axis| 0.5 * (old_m[axis] + way_m[axis])); 2];
        }
        let sighting = Sighting {
            log_odds: match sighting.log_odds {
                odds if !odds.is_nan() => odds,
                _ if self.count > 0 => last.log_odds,
                _ => f64::MIN,
            },
            ..sighting
        };
        // A frame that is sent again is the same sighting.
        if self.count == 0 || way_m.is_some() {
            self.seen.rotate_right(1);
            self.count = (self.count + 1).min(FRAMES_MAX);
        }
        self.seen[0] = sighting;
        self.is_taken = true;
    }

    /// Computes probability, speed and confirmation from the sightings in the window. A confirmed track stays confirmed.
    fn judge(&mut self, settings: &TrackSettings, has_pose: bool) {
        let seen = &self.seen[..self.count];
        let (newest, oldest) = (seen[0], seen[self.count - 1]);
        let way_m = |a: &Sighting, b: &Sighting| {
            let [x, y] = [0, 1].map(|axis| a.place_m[axis] - b.place_m[axis]);
            x.hypot(y)
        };
        let moved_m = way_m(&newest, &oldest);
        let path_m: f64 = seen.windows(2).map(|pair| way_m(&pair[0], &pair[1])).sum();
        let moves = has_pose && moved_m >= MOVED_MIN_M.max(STRAIGHT_MIN * path_m);
        let age = newest.frame - self.first;
        let motion = match moves {
            true => MOVING,
            false if has_pose && age + 1 >= u64::from(settings.window) => STILL,
            false => 0.0,
        };
        let mut best = self.seen.map(|one| one.log_odds);
        let best = &mut best[..self.count];
        best.sort_by(|a, b| b.total_cmp(a));
        let hits = settings.confirm_hits as usize;
        let counted = &best[..hits.min(self.count)];
        let log_odds = counted.iter().sum::<f64>() / counted.len() as f64 + motion;
        self.probability = 1.0 / (1.0 + (-log_odds).exp());
        // The clock may have been set back.
        let is_steady = seen.is_sorted_by(|later, one| later.stamp_ns > one.stamp_ns);
        let seconds = newest.stamp_ns.saturating_sub(oldest.stamp_ns) as f64 * 1e-9;
        self.news = TrackNews {
            age_scans: age.min(u64::from(u32::MAX)) as u32,
            speed_mps: (has_pose && is_steady && seconds > 0.0).then(|| (moved_m / seconds) as f32),
            is_confirmed: self.news.is_confirmed
                || self.count >= hits && self.probability >= settings.probability_min,
        };
    }
}

/// Log odds of a probability in steps of 1/254; clamped, because none is certain.
fn log_odds(probability: f32) -> f64 {
    let sure = f64::from(probability).clamp(0.002, 0.998);
    (sure / (1.0 - sure)).ln()
}

/// Converts a place from the sensor frame into the fixed frame, seen from above; no change while no pose is known.
fn in_fixed_frame(ego: &EgoPose, center_m: [f32; 3]) -> [f64; 2] {
    let [x, y] = [f64::from(center_m[0]), f64::from(center_m[1])];
    if ego.is_known == 0 {
        return [x, y];
    }
    let (sin, cos) = ego.yaw_rad.sin_cos();
    let [ego_x, ego_y, _] = ego.position_m;
    [ego_x + x * cos - y * sin, ego_y + x * sin + y * cos]
}
