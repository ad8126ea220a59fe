//! Scans that the model does not accept: the flags of their lines, the log, and the report of `mluc doctor`.

use mluc_tests::{Running, Setting, car_scan};

#[test]
fn a_low_sensor_is_flagged_logged_and_diagnosed_with_the_remedy() {
    let setting = Setting::new("suspect", 0);
    // The model accepts 1.23 to 2.23 m; these scans are of a sensor 0.73 m above the ground.
    for number in 0..4 {
        let mut points = car_scan(9.0 + number as f32);
        points.iter_mut().for_each(|point| point[2] += 1.0);
        setting.write_scan(&format!("{number:06}"), &points);
    }
    let mut run = setting.up("--loop");
    // The reason comes with each frame, not only when the verdict changes.
    run.wait_for_health(&setting.instance, "ingest says why", |watch| {
        let ingest = watch.of(mluc_ipc_types::Stage::Ingest);
        ingest.is_some_and(|h| h.frames_out > 1 && h.reason().starts_with("suspect input: "))
    });
    let run = setting.stop(run);
    for line in &run.lines {
        let flags = line["flags"].as_array().expect("flags");
        for flag in ["input_suspect", "suspect_height"] {
            assert!(flags.iter().any(|found| found == flag), "{line}");
        }
    }
    let remedy = "expected 1.23 to 2.23 m: mount it there";
    let is_told = |line: &&str| line.contains(remedy) && !line.contains(" state: ");
    let told = run.log.lines().filter(is_told);
    assert_eq!(told.count(), 1, "{}", run.log);
    let (model, input) = (setting.model.display(), setting.input.display());
    let words = format!("doctor --model {model} --input {input}");
    let said = Running::mluc(words.split_whitespace()).finish().text();
    assert!(said.contains(remedy), "{said}");
}
