//! `mluc-lab train` as a person meets it: what is wrong is named, what is done is kept.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use mluc_model::{Model, model_bytes};
use mluc_reproduce::{RunState, run_state};

const LAB: &str = env!("CARGO_BIN_EXE_mluc-lab");

/// A folder with four simulated scans in `data/train`.
struct Place(tempfile::TempDir);

impl Place {
    fn new() -> Place {
        let place = Place(tempfile::tempdir().expect("a folder"));
        let mut command = Command::new(LAB);
        command.args(["simulate", "--family", "sim-kitti", "--split", "train"]);
        command.args(["--frames", "4", "--seed", "3", "--out"]);
        let output = command.arg(place.path("data/train")).output();
        assert!(output.expect("started").status.success());
        place
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// The trainer on these scans, into `run`.
    fn train(&self, run: &str, more: &[&str]) -> Command {
        let mut command = Command::new(LAB);
        command.args(["train", "--setting", "kitti", "--batch", "1"]);
        command.args(["--validate-frames", "0", "--data"]);
        command.arg(self.path("data")).arg("--out");
        command.arg(self.path(run)).args(more);
        command
    }

    /// Trains to the end; gives what was said.
    fn trained(&self, run: &str, more: &[&str]) -> String {
        let output = self.train(run, more).output().expect("started");
        let text = said(&output);
        assert!(output.status.success(), "{text}");
        text
    }

    /// It complains with these words.
    fn refuses(&self, run: &str, more: &[&str], words: &[&str]) {
        let output = self.train(run, more).output().expect("started");
        let text = said(&output);
        assert!(!output.status.success(), "it went on");
        assert!(!text.contains("panicked"), "{text}");
        let fault = text.lines().last().unwrap_or_default();
        assert!(words.iter().all(|word| fault.contains(word)), "{fault}");
    }

    fn model(&self, run: &str) -> Vec<u8> {
        fs::read(self.path(run).join("model.safetensors")).expect("a model")
    }
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Changes a file for as long as `what` takes.
fn with(path: &Path, change: impl Fn(&[u8]) -> Vec<u8>, what: impl Fn()) {
    let before = fs::read(path).expect("a file");
    fs::write(path, change(&before)).expect("written");
    what();
    fs::write(path, before).expect("written");
}

const ONE: [&str; 2] = ["--steps", "1"];

#[test]
fn wrong_data_is_named_before_anything_is_trained() {
    let place = Place::new();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let misspelt = |bytes: &[u8]| text(bytes).replacen("Car ", "Carr ", 1).into();
    let negative = |bytes: &[u8]| {
        let text = text(bytes);
        let mut columns: Vec<&str> = text.split(' ').collect();
        columns[8] = "-1.5";
        columns.join(" ").into()
    };
    type Change<'a> = &'a dyn Fn(&[u8]) -> Vec<u8>;
    let cases: [(&str, Change, &[&str]); 4] = [
        (
            "label_2/000001.txt",
            &misspelt,
            &[
                "000001.txt, line",
                "field type: expected one of Car, Van",
                "found 'Carr'",
            ],
        ),
        (
            "label_2/000001.txt",
            &negative,
            &["000001.txt, line 1, field height", "found '-1.5'"],
        ),
        (
            "calib/000002.txt",
            &|_| b"P2: 1 2 3\n".into(),
            &["000002.txt, line 1"],
        ),
        (
            "velodyne/000003.bin",
            &|bytes| bytes[..bytes.len() - 7].into(),
            &["000003.bin: expected a multiple of 16 bytes"],
        ),
    ];
    for (file, change, words) in cases {
        let file = place.path("data/train").join(file);
        with(&file, change, || place.refuses("run", &ONE, words));
    }
    let label = place.path("data/train/label_2/000001.txt");
    with(&label, misspelt, || {
        place.trained("ignoring", &["--steps", "1", "--ignore-classes", "carr"]);
    });
    place.refuses("threads", &["--threads", "1000000"], &[]);
    assert!(!place.path("threads").exists());
}

#[test]
fn empty_scans_are_told_from_hard_ones() {
    let place = Place::new();
    for name in ["000000", "000001", "000002", "000003"] {
        let scan = place.path(&format!("data/train/velodyne/{name}.bin"));
        fs::write(scan, []).expect("written");
    }
    let options = ["--steps", "1", "--no-augment"];
    place.refuses("run", &options, &["expected points in the labelled boxes"]);
}

#[test]
fn a_killed_run_goes_on_to_the_bits_of_an_uninterrupted_one() {
    let place = Place::new();
    let steps = ["--steps", "8", "--checkpoint-every", "1"];
    place.trained("whole", &steps);

    let mut first = place.train("cut", &steps);
    let mut child = first.stderr(Stdio::null()).spawn().expect("started");
    let checkpoint = place.path("cut/checkpoint.safetensors");
    let patience = Instant::now();
    while !checkpoint.exists() && patience.elapsed() < Duration::from_secs(60) {
        std::thread::sleep(Duration::from_millis(5));
    }
    child.kill().expect("killed");
    child.wait().expect("ended");
    // The log may be cut in a line.
    let log = place.path("cut/train.jsonl");
    fs::write(&log, "{\"step\":1,\"ste").expect("written");
    place.trained("cut", &steps);
    assert_eq!(place.model("cut"), place.model("whole"));
    let state = || run_state(&place.path("cut")).expect("a run");
    assert_eq!(state(), RunState::Done);

    // More steps than were done: not at its end, whatever the log says.
    fs::write(&log, "{\"step\":9,\"steps\":9}\n").expect("written");
    assert_eq!(state(), RunState::Unfinished { step: 8, steps: 9 });
}

#[test]
fn a_run_writes_over_nothing_that_is_not_its_own() {
    let place = Place::new();
    place.trained("run", &ONE);
    let model = place.model("run");

    let other_run = ["checkpoint.safetensors: expected a run with"];
    place.refuses("run", &["--steps", "1", "--seed", "2"], &other_run);
    // Other labels under the same name are other data.
    let label = place.path("data/train/label_2/000001.txt");
    let less = |bytes: &[u8]| {
        let first = bytes
            .iter()
            .position(|byte| *byte == b'\n')
            .expect("a line");
        bytes[first + 1..].to_vec()
    };
    with(&label, less, || {
        place.refuses("run", &ONE, &["expected a run with"])
    });
    fs::remove_file(place.path("run/checkpoint.safetensors")).expect("removed");
    let other_file = ["model.safetensors: expected no file of another run"];
    place.refuses("run", &ONE, &other_file);
    assert_eq!(place.model("run"), model);

    fs::create_dir_all(place.path("busy")).expect("a folder");
    let lock = File::create(place.path("busy/.lock")).expect("a file");
    lock.lock().expect("taken");
    place.refuses("busy", &ONE, &["another run"]);
}

#[test]
fn a_model_that_was_worked_on_since_stays_as_it_is() {
    let place = Place::new();
    let steps = ["--steps", "2"];
    place.trained("run", &steps);
    let path = place.path("run/model.safetensors");
    let mut model = Model::read(&path).expect("a model");
    model.manifest.provenance.threshold_choice = "chosen by hand".into();
    let bytes = model_bytes(&model.manifest, &model.weights).expect("a model");
    fs::write(&path, &bytes).expect("written");
    assert!(place.trained("run", &steps).contains("it stays as it is"));
    assert_eq!(place.model("run"), bytes);
    place.refuses("run", &ONE, &["expected a run of at most 1 steps"]);

    // What is asked of a model that it cannot give is told before the scans are gone through.
    let mut command = Command::new(LAB);
    command.args(["evaluate", "method", "--method", "naive"]);
    command.args(["--data", "nowhere", "--model"]).arg(&path);
    let text = said(&command.output().expect("started"));
    assert!(
        text.contains("naive: expected a model with a Softmax head"),
        "{text}"
    );
}

#[test]
fn osis_is_trained_once_and_over_nothing() {
    let place = Place::new();
    place.trained("softmax", &["--network", "softmax", "--steps", "1"]);
    let init = place.path("softmax").display().to_string();
    let osis = ["--network", "osis", "--init", &init, "--steps", "2"];
    // What another run wrote into a log of this name is kept.
    fs::create_dir_all(place.path("osis")).expect("a folder");
    fs::write(place.path("osis/train.jsonl"), "old\n").expect("written");
    place.trained("osis", &osis);
    let old = fs::read_to_string(place.path("osis/train.old.jsonl"));
    assert_eq!(old.expect("kept"), "old\n");
    let model = place.model("osis");
    assert!(place.trained("osis", &osis).contains("already trained"));
    let other_file = ["expected no file of another run"];
    place.refuses("osis", &[&osis[..], &["--seed", "2"]].concat(), &other_file);
    place.refuses("softmax", &osis, &other_file);
    assert_eq!(place.model("osis"), model);
}

#[test]
fn a_report_looks_at_its_recorded_scans_first() {
    let place = Place::new();
    let mut command = Command::new(LAB);
    command.args(["reproduce", "--quick", "--real", "nowhere", "--data"]);
    command.arg(place.path("made")).arg("--runs");
    command.arg(place.path("runs")).arg("--out");
    let output = command.arg(place.path("out")).output().expect("started");
    let text = said(&output);
    assert!(
        !output.status.success() && text.contains("nowhere"),
        "{text}"
    );
    assert!(!place.path("made").exists());
}

#[test]
#[cfg(target_os = "linux")]
fn a_full_terminal_stops_nothing() {
    let place = Place::new();
    let full = || File::create("/dev/full").expect("there");
    let mut command = place.train("run", &ONE);
    let status = command.stderr(full()).stdout(Stdio::null()).status();
    assert!(status.expect("started").success());
    assert!(!place.model("run").is_empty());
    // The answer itself has to arrive; that it did not is no panic.
    let mut command = place.train("other", &ONE);
    let output = command.stdout(full()).output().expect("started");
    let text = said(&output);
    assert_eq!(output.status.code(), Some(1), "{text}");
    assert!(text.contains("standard output"), "{text}");
}
