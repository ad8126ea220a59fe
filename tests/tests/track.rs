//! `--track`: an unknown object waits for its fifth sighting and keeps its number; known objects do not wait.

use mluc_tests::{Setting, car_scan};
use serde_json::Value;
use std::collections::BTreeSet;

fn of_kind<'a>(list: &'a Value, kind: &str) -> Vec<&'a Value> {
    list.as_array().unwrap().iter().filter(|object| object["kind"] == kind).collect()
}

fn tracks(objects: &[&Value]) -> BTreeSet<u64> {
    let tracks = objects.iter().map(|object| object["track"].as_u64());
    tracks.map(|track| track.expect("a number")).collect()
}

#[test]
fn unknown_objects_wait_for_their_fifth_sighting_and_known_ones_do_not() {
    // The same scan six times, from a sensor that stands still.
    let setting = Setting::new("track", 0);
    for number in 0..6 {
        setting.write_scan(&format!("{number:06}"), &car_scan(9.0));
    }
    let poses = "5 1 0 0.3\n".repeat(6);
    std::fs::write(setting.input.join("poses.txt"), poses).unwrap();
    let plain = setting.run("--refiner-variant none");
    let tracked = setting.run("--refiner-variant none --track");
    tracked.assert_ended(0, 6);
    let unknown = of_kind(&plain.lines[0]["objects"], "unknown").len();
    assert!(unknown > 0, "the untrained model has no candidates");
    let waiting_in = |line: &Value| {
        let mut waiting = of_kind(&line["suppressed"], "unknown");
        waiting.retain(|object| object["reason"] == "unconfirmed");
        assert!(waiting.iter().all(|object| object["confirmed"] == false));
        assert_eq!(waiting.len(), unknown);
        tracks(&waiting)
    };
    let waiting = waiting_in(&tracked.lines[0]);
    assert!((1..4).all(|line| waiting_in(&tracked.lines[line]) == waiting));
    for (line, age) in tracked.lines.iter().zip(0..).skip(4) {
        let published = of_kind(&line["objects"], "unknown");
        assert_eq!(published.len(), unknown);
        assert_eq!(tracks(&published), waiting);
        let is_told = |object: &&Value| object["confirmed"] == true && object["age_scans"] == age;
        assert!(published.iter().all(is_told), "{line}");
    }
    for (with, without) in tracked.lines.iter().zip(&plain.lines) {
        let known = of_kind(&with["objects"], "known");
        assert_eq!(known, of_kind(&without["objects"], "known"));
        assert!(known.iter().all(|object| object["track"].is_null()));
    }
    // Without poses the sensor's motion is estimated.
    std::fs::remove_file(setting.input.join("poses.txt")).unwrap();
    let run = setting.run("--refiner-variant none --track");
    let found = of_kind(&run.lines[5]["objects"], "unknown");
    assert!(found.iter().all(|object| object["speed_mps"] == 0.0));
    assert_eq!(found.len(), unknown);
}
