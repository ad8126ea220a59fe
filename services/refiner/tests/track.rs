//! Temporal voting: what is seen once is held back, what is seen again keeps its number, known objects pass at once.

use mluc_ipc_types::{Disposition, EgoPose, Object, ObjectKind};
use mluc_refiner::{RefinerOutput, TrackSettings, Tracker};
use proptest::prelude::*;

const STILL: EgoPose = EgoPose {
    position_m: [0.0; 3],
    yaw_rad: 0.0,
    is_known: 0,
    reserved: 0,
};

fn object(kind: ObjectKind, x: f32, y: f32, score: f32) -> Object {
    Object {
        kind: kind as u32,
        suppressed_by: Object::NONE,
        track_id: Object::NONE,
        center_m: [x, y, 0.0],
        size_m: [2.0, 1.0, 1.5],
        score,
        ..bytemuck::Zeroable::zeroed()
    }
}

fn frame(objects: &[Object]) -> RefinerOutput {
    let mut refined = RefinerOutput::default();
    refined.objects.extend_from_slice(objects);
    refined.counters.by_disposition[Disposition::Published as usize] = objects.len() as u32;
    refined
}

fn tracker() -> Tracker {
    Tracker::new(TrackSettings::default()).unwrap()
}

#[test]
fn an_unknown_object_is_published_from_its_second_sighting_with_the_same_number() {
    let mut tracker = tracker();
    let mut numbers = Vec::new();
    for sequence in 0..4 {
        let x = 10.0 + 0.4 * sequence as f32;
        let mut seen = frame(&[object(ObjectKind::Unknown, x, 1.0, 0.5)]);
        tracker.update(sequence, &STILL, &mut seen);
        let wanted = match sequence {
            0 => Disposition::Unconfirmed,
            _ => Disposition::Published,
        };
        assert_eq!(
            seen.objects[0].disposition, wanted as u32,
            "frame {sequence}"
        );
        assert_eq!(seen.counters.with_disposition(wanted), 1);
        assert_eq!(seen.counters.by_disposition.iter().sum::<u32>(), 1);
        numbers.push(seen.objects[0].track_id);
    }
    assert_eq!(numbers, [numbers[0]; 4]);
    assert_ne!(numbers[0], Object::NONE);
}

#[test]
fn known_objects_are_never_touched() {
    let mut tracker = tracker();
    let before = object(ObjectKind::Known, 5.0, 0.0, 0.9);
    let mut seen = frame(&[before]);
    tracker.update(0, &STILL, &mut seen);
    assert_eq!(seen.objects[0], before);
}

#[test]
fn one_miss_is_bridged_and_a_whole_window_is_not() {
    for (gap, published) in [(1, true), (2, true), (3, false)] {
        let mut tracker = tracker();
        let unknown = object(ObjectKind::Unknown, 8.0, 2.0, 0.5);
        let mut first = frame(&[unknown]);
        tracker.update(0, &STILL, &mut first);
        let mut again = frame(&[unknown]);
        tracker.update(gap, &STILL, &mut again);
        assert_eq!(again.objects[0].is_published(), published, "gap {gap}");
    }
}

#[test]
fn with_ego_motion_what_stands_still_is_found_again_and_without_it_is_not() {
    // The sensor drives 3 m and turns 30 degrees between two frames; the object stands at (10, 4).
    let poses = [([0.0, 0.0], 0.0), ([3.0, 0.0], std::f64::consts::FRAC_PI_6)];
    let seen_from = |(at, yaw): ([f64; 2], f64)| {
        let (dx, dy) = (10.0 - at[0], 4.0 - at[1]);
        let (sin, cos) = yaw.sin_cos();
        [dx * cos + dy * sin, -dx * sin + dy * cos].map(|v| v as f32)
    };
    for is_known in [0, 1] {
        let mut tracker = tracker();
        let mut last = Disposition::Published as u32;
        for (sequence, pose) in poses.into_iter().enumerate() {
            let [x, y] = seen_from(pose);
            let ego = EgoPose {
                position_m: [pose.0[0], pose.0[1], 0.0],
                yaw_rad: pose.1,
                is_known,
                reserved: 0,
            };
            let mut seen = frame(&[object(ObjectKind::Unknown, x, y, 0.5)]);
            tracker.update(sequence as u64, &ego, &mut seen);
            last = seen.objects[0].disposition;
        }
        let wanted = match is_known {
            1 => Disposition::Published,
            _ => Disposition::Unconfirmed,
        };
        assert_eq!(last, wanted as u32, "pose known: {is_known}");
    }
}

#[test]
fn a_run_that_begins_anew_forgets() {
    let mut tracker = tracker();
    for (sequence, published) in [(7, false), (8, true), (0, false), (1, true)] {
        let mut seen = frame(&[object(ObjectKind::Unknown, 8.0, 2.0, 0.5)]);
        tracker.update(sequence, &STILL, &mut seen);
        assert_eq!(seen.objects[0].is_published(), published, "at {sequence}");
    }
}

#[test]
fn more_objects_than_tracks_pass_without_a_number_and_nothing_grows() {
    const TRACKS_MAX: usize = 512;
    let mut tracker = tracker();
    for sequence in 0..3 {
        let many: Vec<Object> = (0..TRACKS_MAX + 3)
            .map(|n| {
                object(
                    ObjectKind::Unknown,
                    10.0 * n as f32,
                    0.0,
                    1.0 - 0.001 * n as f32,
                )
            })
            .collect();
        let mut seen = frame(&many);
        tracker.update(sequence, &STILL, &mut seen);
        let numbered = seen
            .objects
            .iter()
            .filter(|o| o.track_id != Object::NONE)
            .count();
        assert_eq!(numbered, TRACKS_MAX, "the surest");
        assert_eq!(seen.objects[TRACKS_MAX].track_id, Object::NONE);
        assert!(seen.objects[TRACKS_MAX].is_published(), "nothing is lost");
    }
}

#[test]
fn settings_that_make_no_sense_are_refused_by_name() {
    let wrong = |change: fn(&mut TrackSettings)| {
        let mut settings = TrackSettings::default();
        change(&mut settings);
        Tracker::new(settings).unwrap_err().to_string()
    };
    assert!(wrong(|s| s.confirm_hits = 4).contains("track.confirm_hits"));
    assert!(wrong(|s| s.window = 33).contains("track.window"));
    assert!(wrong(|s| s.distance_max_m = f64::NAN).contains("track.distance_max_m"));
}

proptest! {
    #[test]
    fn no_two_objects_of_a_frame_share_a_number(
        places in prop::collection::vec(prop::collection::vec((-20.0f32..20.0, -20.0f32..20.0), 0..12), 1..8)
    ) {
        let mut tracker = tracker();
        for (sequence, frame_places) in places.iter().enumerate() {
            let objects: Vec<Object> = frame_places
                .iter()
                .map(|&(x, y)| object(ObjectKind::Unknown, x, y, 0.5))
                .collect();
            let mut seen = frame(&objects);
            tracker.update(sequence as u64, &STILL, &mut seen);
            let mut numbers: Vec<u32> = seen.objects.iter().map(|o| o.track_id).collect();
            numbers.sort_unstable();
            numbers.dedup();
            prop_assert_eq!(numbers.len(), objects.len());
        }
    }
}
