//! Evidence over time: an object is held back until its fifth sighting, one seen again keeps its number, a moving one ranks higher, known ones pass at once.

use mluc_ipc_types::{Disposition, EgoPose, FrameHeader, Object, ObjectKind};
use mluc_refiner::{RefinerOutput, TrackSettings, Tracker};
use nalgebra::{Isometry2, Point2, Vector2};
use proptest::prelude::*;

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

/// The objects of a frame after the tracker's update.
fn update(tracker: &mut Tracker, sequence: u64, ego: &EgoPose, objects: &[Object]) -> Vec<Object> {
    let mut out = RefinerOutput::default();
    out.objects.extend_from_slice(objects);
    let header = FrameHeader {
        ego: *ego,
        sensor_stamp_ns: 7 + 100_000_000 * sequence,
        ..FrameHeader::new(sequence, "")
    };
    tracker.update(&header, &mut out);
    out.objects
}

/// An unknown object that is seen at these sequences, after each update.
fn seen_at(sequences: &[u64], x_m: impl Fn(u64) -> f32) -> Vec<Object> {
    let mut tracker = tracker();
    let mut see = |&sequence: &u64| {
        let unknown = object(ObjectKind::Unknown, x_m(sequence), 1.0, 0.5);
        update(&mut tracker, sequence, &EgoPose::default(), &[unknown])[0]
    };
    sequences.iter().map(&mut see).collect()
}

/// A tracker that confirms from the third sighting on.
fn tracker() -> Tracker {
    let settings = TrackSettings { confirm_hits: 3, ..TrackSettings::default() };
    Tracker::new(settings).unwrap()
}

/// An unknown object with a probability, after each of 14 updates, at (20 + speed x time, 1); the sensor does not move.
fn judged(disposition: Disposition, likely: f32, speed_mps: f32, is_known: u32) -> Vec<Object> {
    let mut tracker = tracker();
    let ego = EgoPose::new([0.0; 3], 0.0, is_known);
    let mut see = |sequence| {
        let x_m = 20.0 + 0.1 * speed_mps * sequence as f32;
        let mut unknown = object(ObjectKind::Unknown, x_m, 1.0, 0.1);
        unknown.disposition = disposition as u32;
        unknown.tell_probability(likely);
        update(&mut tracker, sequence, &ego, &[unknown])[0]
    };
    (0..14).map(&mut see).collect()
}

#[test]
fn a_track_is_confirmed_when_it_is_likely_or_moves_over_the_ground() {
    use Disposition::{LowScore, Published, Unconfirmed};
    for (before, probability, speed_mps, is_known, confirmed_from, otherwise) in [
        (Published, 0.7, 0.0, 1, 2, Unconfirmed),
        // An object with a low score is published, too.
        (LowScore, 0.7, 0.0, 1, 2, LowScore),
        (Published, 0.25, 0.0, 1, 99, Unconfirmed),
        (LowScore, 0.25, 0.0, 1, 99, LowScore),
        // It has moved 1.5 m after four frames; without a pose the tracker knows no motion.
        (Published, 0.25, 4.0, 1, 4, Unconfirmed),
        (Published, 0.25, 4.0, 0, 99, Unconfirmed),
        (Published, 0.02, 4.0, 1, 99, Unconfirmed),
    ] {
        let seen = judged(before, probability, speed_mps, is_known);
        for (at, object) in seen.iter().enumerate() {
            let is_confirmed = at >= confirmed_from;
            let expected = [otherwise, Published][usize::from(is_confirmed)];
            let found = object.disposition;
            assert_eq!(found, expected as u32, "{before:?} {probability} {at}");
            let news = object.track().expect("a track");
            let found = (news.is_confirmed, news.age_scans);
            assert_eq!(found, (is_confirmed, at as u32));
            let expected = (is_known == 1 && at > 0).then_some(speed_mps);
            assert_eq!(news.speed_mps, expected);
        }
    }
}

#[test]
fn what_nobody_refined_goes_on_in_a_confirmed_track_and_confirms_none() {
    let (mut tracker, ego) = (tracker(), EgoPose::default());
    let mut see = |sequence, x_m: f32, is_refined: bool| {
        let mut unknown = object(ObjectKind::Unknown, x_m, 1.0, 0.1);
        if is_refined {
            unknown.tell_probability(0.9);
        } else {
            unknown.flags = Object::UNREFINED;
            unknown.disposition = Disposition::LowScore as u32;
        }
        update(&mut tracker, sequence, &ego, &[unknown])[0].is_published()
    };
    let found = [true, true, true, false, false].map(|is_refined| see(0, 8.0, is_refined));
    assert_eq!(found, [false; 5], "a frame that is sent again");
    let refined = [true, true, true, false, false, true];
    let found = [1, 2, 3, 4, 5, 6].map(|frame| see(frame, 8.0, refined[frame as usize - 1]));
    assert_eq!(found, [false, true, true, true, true, true]);
    let found = [7, 8, 9, 10].map(|frame| see(frame, 28.0, false));
    assert_eq!(found, [false; 4]);
    // A low score without a probability is no evidence either.
    let mut weak = object(ObjectKind::Unknown, 48.0, 1.0, 0.1);
    weak.disposition = Disposition::LowScore as u32;
    let mut see = |frame| update(&mut tracker, frame, &ego, &[weak])[0].is_published();
    assert!(!(11..20).any(&mut see));
}

#[test]
fn what_moves_is_ranked_higher_and_what_is_old_and_still_lower_and_stays() {
    let probability = |speed_mps, at: usize| {
        let object = judged(Disposition::Published, 0.5, speed_mps, 1)[at];
        assert!(object.is_published());
        object.probability().expect("told")
    };
    assert!((probability(0.0, 2) - 0.5).abs() < 0.01);
    assert!(probability(0.0, 13) < 0.45 && probability(4.0, 13) > 0.8);
}

#[test]
fn misses_are_bridged_a_whole_window_is_not_and_a_run_that_begins_anew_forgets() {
    for (came, published) in [
        // Two of three frames are lost.
        (&[0, 3, 6][..], &[false, false, true][..]),
        (&[0, 1, 2, 42], &[false, false, true, true]),
        (&[0, 1, 2, 43], &[false, false, true, false]),
        (&[5, 6, 7, 0, 1], &[false, false, true, false, false]),
    ] {
        let seen = seen_at(came, |_| 8.0);
        let found = seen.iter().map(Object::is_published);
        assert!(found.eq(published.iter().copied()), "{came:?}");
    }
    // Every frame comes.
    for (sequences, published) in [
        (&[0, 1, 2][..], &[false, false, true][..]),
        // The second frame is sent again.
        (&[0, 1, 1, 2, 3], &[false, false, false, true, true]),
        (&[0, 4, 9], &[false, false, true]),
        (&[0, 1, 10], &[false, false, false]),
        // Eight misses and nine.
        (&[0, 1, 2, 11], &[false, false, true, true]),
        (&[0, 1, 2, 12], &[false, false, true, false]),
    ] {
        let (mut tracker, mut found, mut last) = (tracker(), vec![], 0);
        for &sequence in sequences {
            let ego = EgoPose::default();
            (last + 1..sequence).for_each(|missed| drop(update(&mut tracker, missed, &ego, &[])));
            let unknown = object(ObjectKind::Unknown, 8.0, 1.0, 0.5);
            found.push(update(&mut tracker, sequence, &ego, &[unknown])[0].is_published());
            last = sequence;
        }
        assert_eq!(found, published, "{sequences:?}");
    }
}

#[test]
fn clouds_that_never_came_and_a_clock_that_is_set_back() {
    let (mut tracker, ego) = (tracker(), EgoPose::new([0.0; 3], 0.0, 1));
    let mut see = |(sequence, ms, x_m): (u64, u64, f32)| {
        let mut out = RefinerOutput::default();
        out.objects.push(object(ObjectKind::Unknown, x_m, 1.0, 0.5));
        let header =
            FrameHeader { ego, sensor_stamp_ns: 1_000_000 * ms, ..FrameHeader::new(sequence, "") };
        tracker.update(&header, &mut out);
        out.objects[0]
    };
    // At 10 m/s. Two clouds are lost before the last one, which has the next number.
    let steady = [(0, 1000, 10.0), (1, 1100, 11.0), (2, 1200, 12.0)].map(&mut see);
    let later = [(3, 1500, 15.0), (4, 1450, 16.0)].map(&mut see);
    assert!(later.iter().all(|o| o.track_id == steady[0].track_id));
    let speeds = later.map(|o| o.track().and_then(|news| news.speed_mps).is_some());
    assert_eq!(speeds, [true, false]);
}

#[test]
fn what_is_fast_is_found_again_beside_what_stands_still() {
    let mut tracker = tracker();
    let mut last = [(Object::NONE, false); 2];
    for sequence in 0..5 {
        // One object at 35 m/s; another one is within 4 m of its first position.
        let places_m = [(10.0 + 3.5 * sequence as f32, 1.0), (12.0, 3.0)];
        let objects = places_m.map(|(x, y)| object(ObjectKind::Unknown, x, y, 0.5));
        let seen = update(&mut tracker, sequence, &EgoPose::default(), &objects);
        let found = [0, 1].map(|n| (seen[n].track_id, seen[n].is_published()));
        let is_same = [0, 1].map(|n| found[n].0 == last[n].0);
        assert_eq!(is_same, [sequence > 1, sequence > 0], "{sequence}");
        last = found;
    }
    assert!(last[0].1 && last[1].1);
}

#[test]
fn with_ego_motion_what_stands_still_is_found_again_and_without_it_is_not() {
    // The sensor drives 3 m and turns 30 degrees between the second frame and the third; the object stands at (10, 4).
    let turned = Isometry2::new(Vector2::new(3.0, 0.0), std::f64::consts::FRAC_PI_6);
    let poses = [Isometry2::identity(), Isometry2::identity(), turned];
    for is_known in [0, 1] {
        let mut tracker = tracker();
        let mut last = true;
        for (sequence, pose) in poses.into_iter().enumerate() {
            let place = pose.inverse_transform_point(&Point2::new(10.0, 4.0));
            let at = pose.translation;
            let ego = EgoPose::new([at.x, at.y, 0.0], pose.rotation.angle(), is_known);
            let unknown = object(ObjectKind::Unknown, place.x as f32, place.y as f32, 0.5);
            let seen = update(&mut tracker, sequence as u64, &ego, &[unknown]);
            last = seen[0].is_published();
        }
        assert_eq!(last, is_known == 1, "pose known: {is_known}");
    }
}

#[test]
fn more_objects_than_tracks_pass_without_a_number_and_nothing_grows() {
    const TRACKS_MAX: usize = 512;
    let mut tracker = tracker();
    for sequence in 0..3 {
        let numbers = (0..TRACKS_MAX + 3).map(|n| n as f32);
        let unknown = |n| object(ObjectKind::Unknown, 10.0 * n, 0.0, 1.0 - 0.001 * n);
        let many: Vec<Object> = numbers.map(unknown).collect();
        let seen = update(&mut tracker, sequence, &EgoPose::default(), &many);
        let numbered = seen.iter().filter(|o| o.track_id != Object::NONE).count();
        assert_eq!(numbered, TRACKS_MAX, "the surest");
        assert_eq!(seen[TRACKS_MAX].track_id, Object::NONE);
        assert!(seen[TRACKS_MAX].is_published(), "nothing is lost");
    }
}

proptest! {
    #[test]
    fn no_two_objects_of_a_frame_share_a_number(
        places in prop::collection::vec(prop::collection::vec((-20.0f32..20.0, -20.0f32..20.0), 0..12), 1..8)
    ) {
        let mut tracker = tracker();
        for (sequence, frame_places) in places.iter().enumerate() {
            let objects = frame_places.iter().map(|&(x, y)| object(ObjectKind::Unknown, x, y, 0.5));
            let objects: Vec<Object> = objects.collect();
            let seen = update(&mut tracker, sequence as u64, &EgoPose::default(), &objects);
            let mut numbers: Vec<u32> = seen.iter().map(|o| o.track_id).collect();
            numbers.sort_unstable();
            numbers.dedup();
            prop_assert_eq!(numbers.len(), objects.len());
        }
    }
}
