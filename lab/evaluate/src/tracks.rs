//! Unknown objects as events: a tracked object is one alarm, however many scans show it.
//!
//! A track is false when most of its objects are on no label. A label with a track id is found when an unknown object
//! with a track is on it in one of its scans. The counting rules are the same as in [`crate::Operating`].

use crate::operating::{Place, counted, is_on, lies_on};
use crate::{ClassRule, Difficulty, LabelledFrame, ObjectKind, UNKNOWN};
use serde::Serialize;
use std::collections::BTreeMap;

/// Minimum number of scans in which a label must count: an object seen for a shorter time cannot be confirmed.
const SCANS_MIN: usize = 5;
const SCANS_A_MINUTE: f64 = 600.0;

/// Tracks of unknown objects over all drives.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Tracks {
    /// Tracks with at least one published object.
    pub tracks: usize,
    /// False tracks.
    pub on_no_label: usize,
    /// False tracks per minute at 10 Hz.
    pub on_no_label_a_minute: f64,
    /// Labels of the unknown classes with a track id that count in five scans or more.
    pub labels: usize,
    /// Labels of these that were found.
    pub found: usize,
}

impl Tracks {
    /// Counts frames in order of their drives; `drives` has the frame count of each. `None` without track ids, or where unknown objects have none.
    pub fn of(frames: &[LabelledFrame], drives: &[usize], rules: &[ClassRule]) -> Option<Tracks> {
        let mut all = Tracks::default();
        let mut rest = frames;
        for count in drives {
            let (drive, others) = rest.split_at(*count);
            rest = others;
            // By track id: false objects and all objects; by label: scans and whether it was found.
            let mut tracks = BTreeMap::<u32, [usize; 2]>::new();
            let mut labels = BTreeMap::<u32, (usize, bool)>::new();
            for frame in drive {
                let near = counted(frame);
                let followed = near.detections.iter().filter(|d| d.is(UNKNOWN));
                let followed: Vec<_> = followed.filter_map(|d| Some((d, d.track?))).collect();
                for (object, track) in &followed {
                    let place = lies_on(object, ObjectKind::Unknown, frame, rules);
                    let [wrong, seen] = tracks.entry(*track).or_default();
                    *wrong += usize::from(place == Place::Nothing);
                    *seen += 1;
                }
                let unknown = |rule: &&ClassRule| rule.kind == ObjectKind::Unknown;
                for label in near.labels.iter() {
                    let mut rules = rules.iter().filter(unknown);
                    let counts = rules.any(|rule| rule.counts_at(label, Difficulty::Moderate));
                    if let Some(number) = label.track.filter(|_| counts) {
                        let (scans, is_found) = labels.entry(number).or_default();
                        *scans += 1;
                        *is_found |= followed.iter().any(|(object, _)| is_on(object, label));
                    }
                }
            }
            let counting = labels.values().filter(|(scans, _)| *scans >= SCANS_MIN);
            all.labels += counting.clone().count();
            all.found += counting.filter(|(_, is_found)| *is_found).count();
            all.tracks += tracks.len();
            let wrong = tracks.values().filter(|[wrong, seen]| 2 * wrong > *seen);
            all.on_no_label += wrong.count();
        }
        all.on_no_label_a_minute = all.on_no_label as f64 * SCANS_A_MINUTE / frames.len() as f64;
        let mut objects = frames.iter().flat_map(|frame| &frame.detections);
        let is_followed = all.tracks > 0 || !objects.any(|object| object.is(UNKNOWN));
        (is_followed && all.tracks + all.labels > 0).then_some(all)
    }
}

impl std::fmt::Display for Tracks {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "unknown tracks: {}; on no label {}, {:.1} a minute; labels of {SCANS_MIN} scans or more: {} of {} found",
            self.tracks, self.on_no_label, self.on_no_label_a_minute, self.found, self.labels
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::UnknownProtocol;
    use crate::tests::{found_at, frame, label};
    use mluc_dataset::Label;

    #[test]
    fn a_track_is_one_alarm_and_a_label_is_found_once() {
        let van = ["van".to_owned()];
        let rules = [ClassRule::unknown(&van, 0.1, UnknownProtocol::Literal)];
        let numbered = |label: Label, track| Label { track: Some(track), ..label };
        let scan = |i: u32| {
            let labels = [(10.0, 0), (30.0, 1)].map(|(x_m, n)| numbered(label("Van", x_m), n));
            // Track 4 is on the first van in every other scan, track 5 is on nothing in most; the last object has no track.
            let second_m = if i == 0 { 30.0 } else { 50.0 };
            let places = [(10.0, 4), (second_m, 5), (60.0, 6 + i / 3)];
            let objects = places.map(|(x_m, n)| numbered(found_at(x_m, UNKNOWN, 0.5), n));
            let brief = numbered(label("Van", -20.0), 2 + i);
            let alone = found_at(-20.0, UNKNOWN, 0.5);
            let labels = labels.into_iter().chain([brief]);
            let objects = objects.into_iter().chain([alone]);
            frame(labels.collect(), objects.collect())
        };
        let frames: Vec<LabelledFrame> = (0..6).map(scan).collect();
        let found = Tracks::of(&frames, &[6], &rules).expect("tracks");
        let expected =
            Tracks { tracks: 4, on_no_label: 3, on_no_label_a_minute: 300.0, labels: 2, found: 2 };
        assert_eq!(found, expected);
        // The same ids in another drive are other objects.
        let two = Tracks::of(&frames, &[3, 3], &rules).expect("tracks");
        assert_eq!((two.tracks, two.labels), (6, 0));
        assert_eq!(Tracks::of(&[frame(vec![], vec![])], &[1], &rules), None);
        let unseen = frames.iter().map(|f| frame(f.labels.to_vec(), vec![]));
        let unseen: Vec<LabelledFrame> = unseen.collect();
        let found = Tracks::of(&unseen, &[6], &rules).expect("labels");
        assert_eq!((found.tracks, found.labels, found.found), (0, 2, 0));
    }
}
