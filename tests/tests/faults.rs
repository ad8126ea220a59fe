//! Bad input: a clear error, or a flagged frame and the next one.

use std::fs;

use mluc_tests::{Setting, car_scan, write_scan};

/// It must end with this code, without a line, and say these words.
fn refuses(setting: &Setting, code: i32, more: &[&str], words: &[&str]) {
    let run = setting.run(more);
    assert_eq!(run.code, Some(code), "{}", run.log);
    assert!(run.lines.is_empty());
    for word in words {
        assert!(
            run.log.contains(word),
            "'{word}' is missing in: {}",
            run.log
        );
    }
}

#[test]
fn damaged_scans_are_flagged_and_the_next_one_comes() {
    let setting = Setting::new("damaged", 0);
    let good = car_scan(10.0);
    let scan = |name: &str| setting.input.join(name);
    write_scan(&scan("0-good.bin"), &good);
    let mut holes = good.clone();
    holes[5] = [f32::NAN; 4];
    holes[9][2] = f32::INFINITY;
    write_scan(&scan("1-holes.bin"), &holes);
    write_scan(&scan("2-cut.bin"), &good);
    let whole = fs::read(scan("2-cut.bin")).unwrap();
    fs::write(scan("2-cut.bin"), &whole[..whole.len() - 7]).unwrap();
    fs::write(scan("3-empty.bin"), b"").unwrap();
    let million: Vec<[f32; 4]> = good.iter().cycle().take(1_000_000).copied().collect();
    write_scan(&scan("4-million.bin"), &million);
    fs::create_dir(scan("5-folder.bin")).unwrap();
    write_scan(&scan("6-good.bin"), &good);

    let run = setting.run(&[]);
    assert_eq!(run.code, Some(0), "{}", run.log);
    let names = [
        "0-good",
        "1-holes",
        "2-cut",
        "3-empty",
        "4-million",
        "5-folder",
        "6-good",
    ];
    assert_eq!(run.frames(), names);
    for (frame, flag) in [
        ("1-holes", "not_finite"),
        ("2-cut", "damaged_input"),
        ("3-empty", "empty"),
        ("4-million", "truncated"),
        ("5-folder", "damaged_input"),
        ("5-folder", "empty"),
    ] {
        assert!(
            run.flags(frame).contains(&flag),
            "{frame}: {:?}",
            run.flags(frame)
        );
    }
    for frame in ["0-good", "6-good"] {
        for flag in [
            "not_finite",
            "damaged_input",
            "empty",
            "truncated",
            "points_gone",
            "resent",
        ] {
            assert!(!run.flags(frame).contains(&flag), "{frame}: {flag}");
        }
    }
    assert_eq!(
        run.lines[0]["objects"], run.lines[6]["objects"],
        "the same scan, the same objects"
    );
}

#[test]
fn a_missing_or_empty_input_is_a_failure() {
    let mut setting = Setting::new("input", 0);
    refuses(&setting, 1, &[], &["no .bin scans", "velodyne"]);
    setting.input = setting.folder.path().join("nowhere");
    refuses(&setting, 1, &[], &["nowhere", "No such file"]);
}

#[test]
fn a_bad_model_is_a_failure() {
    let mut setting = Setting::new("model", 1);
    let whole = fs::read(&setting.model).unwrap();
    fs::write(&setting.model, &whole[..whole.len() / 2]).unwrap();
    refuses(&setting, 1, &[], &["untrained.safetensors", "cut short"]);
    setting.model = "nosuchmodel".into();
    refuses(&setting, 2, &[], &["nosuchmodel", "no such file"]);
}

#[test]
fn a_bad_configuration_is_a_usage_error() {
    let setting = Setting::new("config", 1);
    let path = setting.config("pase = \"complete\"\n");
    refuses(
        &setting,
        2,
        &["--config", &path],
        &["mluc.toml", "`pase`", "did you mean `pace`?"],
    );
    for (argument, words) in [
        (&["--lambda=-1"][..], &["lambda"][..]),
        (&["--unknown-min=2"], &["unknown_min", "0 to 1"]),
        (&["--unknown-min=0.5"], &["unknown_min", "--lambda"]),
        (&["--refiner-mode", "papr"], &["did you mean 'paper'?"]),
    ] {
        refuses(&setting, 2, argument, words);
    }
}

#[test]
fn a_second_pipeline_of_the_same_name_is_refused_and_the_first_goes_on() {
    let setting = Setting::new("second", 3);
    let mut first = setting.up(&["--loop"]);
    first.wait_until("the first frame is out", |p| p.line_count() > 0);
    let second = setting.up(&["--loop"]).finish();
    assert_eq!(second.code, Some(1), "{}", second.log);
    let pid = first.pid().to_string();
    for word in ["pipeline", &setting.instance, &pid, "--instance"] {
        assert!(
            second.log.contains(word),
            "'{word}' is missing in: {}",
            second.log
        );
    }
    let before = first.line_count();
    first.wait_until("more frames are out", |p| p.line_count() > before + 2);
}

#[test]
fn a_stage_that_cannot_start_ends_the_run_and_says_so() {
    let setting = Setting::new("foreign", 1);
    let path = setting.config("[stages.refiner]\ncommand = [\"/nowhere/refiner\"]\n");
    refuses(
        &setting,
        1,
        &["--config", &path],
        &["/nowhere/refiner", "refiner failed to start 3 times"],
    );
}
