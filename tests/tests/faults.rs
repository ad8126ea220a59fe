//! Bad input, a full disk, a reader that is gone: a clear error, or a flagged frame and then the next frame; never a panic.

use mluc_tests::{Running, Setting, assert_has, car_scan, leftovers, mluc_program};
use std::{fs, fs::File, process::Command, process::Stdio};

/// The run must end with this code, without a line, and its log must have these words.
#[track_caller]
fn refuses(setting: &Setting, code: i32, options: &str, words: &[&str]) {
    let run = setting.run(options);
    run.assert_ended(code, 0);
    run.assert_says(words);
}

#[test]
fn damaged_scans_are_flagged_and_the_next_one_comes() {
    let setting = Setting::new("damaged", 0);
    let good = car_scan(10.0);
    let whole = fs::read(setting.write_scan("0-good", &good)).unwrap();
    let mut holes = good.clone();
    holes[5] = [f32::NAN; 4];
    holes[9][2] = f32::INFINITY;
    setting.write_scan("1-holes", &holes);
    fs::write(setting.input.join("2-cut.bin"), &whole[..whole.len() - 7]).unwrap();
    setting.write_scan("3-empty", &[]);
    let million: Vec<[f32; 4]> = good.iter().cycle().take(1_000_000).copied().collect();
    setting.write_scan("4-million", &million);
    fs::create_dir(setting.input.join("5-folder.bin")).unwrap();
    setting.write_scan("6-good", &good);

    let run = setting.run("");
    run.assert_ended(0, 7);
    let expected: [(&str, &[&str]); 7] = [
        ("0-good", &[]),
        ("1-holes", &["not_finite"]),
        ("2-cut", &["damaged_input"]),
        ("3-empty", &["empty"]),
        ("4-million", &["truncated"]),
        ("5-folder", &["damaged_input", "empty"]),
        ("6-good", &[]),
    ];
    assert_eq!(run.frames(), expected.map(|(frame, _)| frame));
    let of_input = "not_finite damaged_input empty truncated points_gone resent";
    for (frame, flags) in expected {
        let found = run.flags(frame);
        let has_all = flags.iter().all(|flag| found.contains(flag));
        let is_sound = !of_input.split(' ').any(|flag| found.contains(&flag));
        assert!(has_all && is_sound == flags.is_empty(), "{frame}: {found:?}");
    }
    let objects = |line: usize| &run.lines[line]["objects"];
    assert_eq!(objects(0), objects(6), "the same scan, the same objects");
}

#[test]
fn a_scan_that_kills_a_stage_twice_is_set_aside_and_named() {
    let setting = Setting::new("poison", 4);
    setting.write_hanging_scan("000002");
    let run = setting.run(&setting.config("[stages.ingest]\nstart_max_ms = 4000\n"));
    run.assert_complete(3, 4);
    let named = "set aside, because stages died of them: 1 (000002)";
    run.assert_says(&[named, "restarted: 2"]);
    let is_empty = |frame: &str| run.flags(frame).contains(&"empty");
    assert!(is_empty("000002") && run.flags("000002").contains(&"damaged_input"));
    assert!(!is_empty("000003"));
}

#[test]
fn a_run_without_a_usable_frame_fails_and_one_with_a_usable_frame_does_not() {
    let setting = Setting::new("garbage", 0);
    setting.write_scan("empty", &[]);
    setting.write_scan("nan", &[[f32::NAN; 4]; 1000]);
    fs::write(setting.input.join("text.bin"), b"hello").unwrap();
    setting.write_scan("far", &[[500.0, 0.0, 0.0, 0.5]; 1000]);
    let garbage = setting.run("");
    garbage.assert_ended(1, 4);
    garbage.assert_says(&["no frame was usable", "empty 3"]);
    let silent = setting.config("[stages.ingest]\ncommand = [\"true\"]\n");
    refuses(&setting, 1, &silent, &["the input gave no scan"]);
    setting.write_scan("scan", &car_scan(8.0));
    setting.run("").assert_ended(0, 5);
}

#[test]
fn a_missing_or_empty_input_is_a_failure() {
    let mut setting = Setting::new("input", 0);
    refuses(&setting, 1, "", &["no scans", "velodyne"]);
    setting.input = setting.folder.path().join("nowhere");
    refuses(&setting, 1, "", &["nowhere", "No such file"]);
}

#[test]
fn a_bad_model_is_a_failure() {
    let mut setting = Setting::new("model", 1);
    let whole = fs::read(&setting.model).unwrap();
    fs::write(&setting.model, &whole[..whole.len() / 2]).unwrap();
    refuses(&setting, 1, "", &["untrained.safetensors", "cut short"]);
    setting.model = "nosuchmodel".into();
    refuses(&setting, 2, "", &["nosuchmodel", "no such file"]);
}

#[test]
fn a_stage_that_cannot_start_ends_the_run_and_says_so() {
    let setting = Setting::new("foreign", 1);
    let text = "restart_limit = 3\n[stages.refiner]\ncommand = [\"/nowhere/refiner\"]\n";
    let words = ["/nowhere/refiner", "refiner died 3 times in a row"];
    refuses(&setting, 1, &setting.config(text), &words);
    // With the other policy the other stages run on.
    let config = setting.config(&format!("on_restart_limit = \"degraded\"\n{text}"));
    let mut run = setting.up(&config);
    run.wait_for_words("the others run on without it");
    assert_eq!(run.stages().len(), 3);
    setting.stop(run).assert_ended(0, 0);
}

#[test]
fn a_stage_that_dies_again_and_again_is_a_crash_loop_and_waits_longer_each_time() {
    let setting = Setting::new("loop", 1);
    let text = "on_restart_limit = \"degraded\"\n[stages.refiner]\ncommand = [\"false\"]\n";
    let mut run = setting.up(&setting.config(text));
    run.wait_for_words("crash loop: died by itself 6 times");
    let log = run.log();
    let delays = log.split("restart in ").skip(1).map(|rest| {
        let text = rest.split_whitespace().next().unwrap_or_default();
        text.trim_end_matches("ms").parse().unwrap_or(0)
    });
    let delays: Vec<u32> = delays.take(3).collect();
    assert_eq!(delays, [50, 100, 200], "{log}");
    setting.stop(run).assert_ended(0, 0);
}

#[test]
fn a_demo_that_cannot_be_printed_ends_with_an_error_and_leaves_nothing() {
    let full = || Stdio::from(File::create("/dev/full").expect("Linux has it"));
    let folder = tempfile::tempdir().expect("a folder");
    let picture = folder.path().join("picture.png");
    let mut demo = Command::new(mluc_program());
    demo.arg("demo").arg("--picture").arg(&picture);
    let run = Running::start_into(&mut demo, full(), Stdio::piped());
    let instance = format!("demo-{}", run.pid());
    let run = run.finish();
    run.assert_ended(1, 0);
    run.assert_says(&["standard output"]);
    assert!(!run.log.contains("panicked"), "{}", run.log);
    assert_eq!(leftovers(&instance), [""; 0]);

    // A log that cannot be written stops nothing.
    let run = Running::start_into(&mut demo, Stdio::piped(), full()).finish();
    assert_eq!(run.code, Some(0));
    let told = ["  UNKNOWN ", "end to end ", "picture of frame 0"];
    assert_has(&run.text(), &told);
    assert!(fs::read(&picture).unwrap().starts_with(b"\x89PNG"));

    // The user gives a file that is no scan.
    let text = folder.path().join("text.bin");
    fs::write(&text, [b'a'; 1600]).expect("written");
    let run = Running::start(demo.arg("--input").arg(&text)).finish();
    assert_eq!(run.code, Some(1), "{}", run.log);
    run.assert_says(&["f32 in little-endian order"]);
}
