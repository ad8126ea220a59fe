//! Frames go through four processes and come out: all of them, in order, nothing copied, nothing left behind.

use std::time::Duration;

use mluc_tests::{Pipeline, clean_folder, leftovers, unique_instance, untrained_model};
use rustix::process::Signal;

#[test]
fn all_frames_come_out_in_order() {
    let folder = tempfile::tempdir().unwrap();
    let (model, input) = (
        untrained_model(folder.path()),
        clean_folder(folder.path(), 12),
    );
    let instance = unique_instance("order");
    let run = Pipeline::up(&instance, &model, &input, &["--pace", "complete"]).finish();
    assert_eq!(run.code, Some(0), "{}", run.log);
    let expected: Vec<String> = (0..12).map(|number| format!("{number:06}")).collect();
    assert_eq!(run.frames(), expected);
    for (number, line) in run.lines.iter().enumerate() {
        assert_eq!(
            (&line["wire"], &line["sequence"]),
            (&1.into(), &number.into())
        );
        assert!(line["latency_us"].as_u64().unwrap() > 0);
        for stage in ["ingest", "backbone", "head", "refiner"] {
            assert!(line["stages"][stage]["run_us"].is_u64(), "{line}");
        }
    }
    assert!(run.log.contains("12 in, 12 out, 0 lost"), "{}", run.log);
    assert_eq!(leftovers(&instance), Vec::<String>::new());
}
