//! Bad input: a clear error, or a flagged frame and the next one.

use std::fs;
use std::path::PathBuf;

use mluc_tests::{
    Finished, Pipeline, car_scan, clean_folder, leftovers, unique_instance, untrained_model,
    write_scan,
};
use tempfile::TempDir;

struct Setting {
    folder: TempDir,
    model: PathBuf,
    input: PathBuf,
    instance: String,
}

fn setting(label: &str, scans: usize) -> Setting {
    let folder = tempfile::tempdir().unwrap();
    Setting {
        model: untrained_model(folder.path()),
        input: clean_folder(folder.path(), scans),
        instance: unique_instance(label),
        folder,
    }
}

impl Setting {
    fn run(&self, more: &[&str]) -> Finished {
        let run = Pipeline::up(&self.instance, &self.model, &self.input, more).finish();
        assert_eq!(
            leftovers(&self.instance),
            Vec::<String>::new(),
            "{}",
            run.log
        );
        run
    }

    /// It must end with this code, without a line, and say these words.
    fn refuses(&self, code: i32, more: &[&str], words: &[&str]) {
        let run = self.run(more);
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
}

#[test]
fn damaged_scans_are_flagged_and_the_next_one_comes() {
    let setting = setting("damaged", 0);
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

    let run = setting.run(&["--pace", "complete"]);
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
    let mut setting = setting("input", 0);
    setting.refuses(1, &[], &["no .bin scans", "velodyne"]);
    setting.input = setting.folder.path().join("nowhere");
    setting.refuses(1, &[], &["nowhere", "No such file"]);
}

#[test]
fn a_bad_model_is_a_failure() {
    let mut setting = setting("model", 1);
    let whole = fs::read(&setting.model).unwrap();
    fs::write(&setting.model, &whole[..whole.len() / 2]).unwrap();
    setting.refuses(1, &[], &["untrained.safetensors", "cut short"]);
    setting.model = "nosuchmodel".into();
    setting.refuses(1, &[], &["nosuchmodel", "no such file"]);
}

#[test]
fn a_bad_configuration_is_a_usage_error() {
    let setting = setting("config", 1);
    let config = setting.folder.path().join("mluc.toml");
    fs::write(&config, "pase = \"complete\"\n").unwrap();
    let path = config.display().to_string();
    setting.refuses(
        2,
        &["--config", &path],
        &["mluc.toml", "`pase`", "did you mean `pace`?"],
    );
    setting.refuses(2, &["--lambda=-1"], &["lambda"]);
    setting.refuses(2, &["--unknown-min=2"], &["unknown_min", "0 to 1"]);
    setting.refuses(2, &["--unknown-min=0.5"], &["unknown_min", "--lambda"]);
    setting.refuses(
        2,
        &["--refiner-mode", "litral"],
        &["did you mean 'literal'?"],
    );
}

#[test]
fn a_second_pipeline_of_the_same_name_is_refused_and_the_first_goes_on() {
    let setting = setting("second", 3);
    let more = ["--pace", "complete", "--loop"];
    let mut first = Pipeline::up(&setting.instance, &setting.model, &setting.input, &more);
    first.wait_until("the first frame is out", |p| p.line_count() > 0);
    let second = Pipeline::up(&setting.instance, &setting.model, &setting.input, &more).finish();
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
    let setting = setting("foreign", 1);
    let config = setting.folder.path().join("mluc.toml");
    fs::write(
        &config,
        "[stages.refiner]\ncommand = [\"/nowhere/refiner\"]\n",
    )
    .unwrap();
    let path = config.display().to_string();
    setting.refuses(
        1,
        &["--config", &path],
        &["/nowhere/refiner", "refiner failed to start 3 times"],
    );
}
