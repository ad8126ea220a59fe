//! `mluc record --stages` and `mluc replay` at any stage.

use mluc_tests::{Finished, Setting};
use rustix::process::Signal;

#[test]
fn a_recording_with_stages_is_replayed_from_each_of_them() {
    let setting = Setting::new("replay", 6);
    let record = |name: &str, options: &str| {
        let (record, path) = setting.start_record(name, options);
        let mut run = setting.up("--pace sensor --rate 5 --loop");
        run.wait_for_lines(8);
        run.stop();
        record.signal(Signal::TERM);
        setting.finish(record).assert_ended_well();
        path
    };
    let replay = |path: &str, options: &str| setting.replay(path, options);
    let path = record("stages.mcap", "--stages");
    // A replay ends even if the configuration says `loop = true`.
    let config = setting.config("loop = true");
    let model = format!("--model {} {config}", setting.model.display());
    for from in ["", "--from head", "--from refiner"] {
        let same = replay(&path, &format!("{model} {from}"));
        same.assert_ended(0, 0);
        same.assert_says(&[" with the recorded objects, 0 with others"]);
    }
    // The parts together are the whole recording.
    let scans = |finished: &Finished| -> u64 {
        let told = finished.log.split_once(" with the recorded objects");
        let count = told.and_then(|(head, _)| head.rsplit(' ').next()?.parse().ok());
        count.unwrap_or_else(|| panic!("{}", finished.log))
    };
    let whole = scans(&replay(&path, &format!("{model} --from head")));
    let part = |i: u32| replay(&path, &format!("{model} --from head --shard {i}/3"));
    let parts = [0, 1, 2].map(|i| scans(&part(i)));
    assert_eq!(parts.iter().sum::<u64>(), whole, "{parts:?}");
    assert!(parts.iter().all(|part| *part < whole), "{parts:?}");
    // Without the gate all boxes are known. The gate belongs to the head, so it does not affect recorded detections.
    for (from, code) in [("head", 1), ("refiner", 0)] {
        let other = replay(&path, &format!("{model} --from {from} --lambda 0"));
        assert_eq!(other.code, Some(code), "{from}: {}", other.log);
    }
    // Thresholds of the refiner do affect them.
    let other = replay(&path, &format!("{model} --from refiner --min-score 0.99"));
    assert_eq!(other.code, Some(1), "{}", other.log);
    let other_model = replay(&path, "--from refiner --model any");
    assert_eq!(other_model.code, Some(1), "{}", other_model.log);
    other_model.assert_says(&["name the same model with --model"]);
    let plain = record("plain.mcap", "");
    let refused = replay(&plain, &format!("{model} --from head"));
    assert_eq!(refused.code, Some(1), "{}", refused.log);
    refused.assert_says(&["/mluc/stage/features", "`mluc record --stages`"]);
}
