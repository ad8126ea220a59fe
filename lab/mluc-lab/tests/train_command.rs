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

    /// Its complaint.
    fn fault(&self, run: &str, more: &[&str]) -> String {
        let output = self.train(run, more).output().expect("started");
        assert!(!output.status.success(), "it went on");
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!text.contains("panicked"), "{text}");
        text.lines().last().unwrap_or_default().to_owned()
    }

    fn model(&self, run: &str) -> Vec<u8> {
        fs::read(self.path(run).join("model.safetensors")).expect("a model")
    }
}

fn succeeds(output: &Output) {
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{text}");
}

/// Changes a file for as long as `what` takes.
fn with(path: &Path, change: impl Fn(String) -> String, what: impl Fn()) {
    let before = fs::read(path).expect("a file");
    let text = String::from_utf8_lossy(&before).into_owned();
    fs::write(path, change(text)).expect("written");
    what();
    fs::write(path, before).expect("written");
}

#[test]
fn wrong_data_is_named_before_anything_is_trained() {
    let place = Place::new();
    let label = place.path("data/train/label_2/000001.txt");
    let calibration = place.path("data/train/calib/000002.txt");
    let scan = place.path("data/train/velodyne/000003.bin");
    let few = ["--steps", "1"];

    let misspelt = |text: String| text.replacen("Car ", "Carr ", 1);
    with(&label, misspelt, || {
        let fault = place.fault("class", &few);
        assert!(fault.contains("000001.txt, line"), "{fault}");
        assert!(
            fault.contains("field type: expected one of Car, Van"),
            "{fault}"
        );
        assert!(fault.contains("found 'Carr'"), "{fault}");
        let mut ignoring = place.train("ignoring", &["--steps", "1", "--ignore-classes", "carr"]);
        succeeds(&ignoring.output().expect("started"));
    });
    let negative = |text: String| {
        let mut columns: Vec<String> = text.split(' ').map(str::to_owned).collect();
        columns[8] = "-1.5".into();
        columns.join(" ")
    };
    with(&label, negative, || {
        let fault = place.fault("size", &few);
        assert!(
            fault.contains("000001.txt, line 1, field height"),
            "{fault}"
        );
        assert!(fault.contains("found '-1.5'"), "{fault}");
    });
    with(
        &calibration,
        |_| "P2: 1 2 3\n".into(),
        || {
            let fault = place.fault("calib", &few);
            assert!(fault.contains("000002.txt, line 1"), "{fault}");
        },
    );
    let whole = fs::read(&scan).expect("a scan");
    fs::write(&scan, &whole[..whole.len() - 7]).expect("written");
    let fault = place.fault("scan", &few);
    assert!(
        fault.contains("000003.bin: expected a multiple of 16 bytes"),
        "{fault}"
    );
    fs::write(&scan, whole).expect("written");

    let fault = place.fault("threads", &["--threads", "1000000"]);
    assert!(!place.path("threads").exists(), "{fault}");
}

#[test]
fn empty_scans_are_told_from_hard_ones() {
    let place = Place::new();
    for name in ["000000", "000001", "000002", "000003"] {
        let scan = place.path(&format!("data/train/velodyne/{name}.bin"));
        fs::write(scan, []).expect("written");
    }
    let fault = place.fault("run", &["--steps", "1", "--no-augment"]);
    assert!(
        fault.contains("expected points in the labelled boxes"),
        "{fault}"
    );
}

#[test]
fn a_killed_run_goes_on_to_the_bits_of_an_uninterrupted_one() {
    let place = Place::new();
    let steps = ["--steps", "8", "--checkpoint-every", "1"];
    succeeds(&place.train("whole", &steps).output().expect("started"));

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
    succeeds(&place.train("cut", &steps).output().expect("started"));
    assert_eq!(place.model("cut"), place.model("whole"));
    assert_eq!(
        run_state(&place.path("cut")).expect("a run"),
        RunState::Done
    );

    // More steps than were done: not at its end, whatever the log says.
    let line = "{\"step\":9,\"steps\":9}\n";
    fs::write(&log, line).expect("written");
    let unfinished = RunState::Unfinished { step: 8, steps: 9 };
    assert_eq!(run_state(&place.path("cut")).expect("a run"), unfinished);
}

#[test]
fn a_run_writes_over_nothing_that_is_not_its_own() {
    let place = Place::new();
    let steps = ["--steps", "1"];
    succeeds(&place.train("run", &steps).output().expect("started"));
    let model = place.model("run");

    let fault = place.fault("run", &["--steps", "1", "--seed", "2"]);
    assert!(
        fault.contains("checkpoint.safetensors: expected a run with"),
        "{fault}"
    );
    // Other labels under the same name are other data.
    let label = place.path("data/train/label_2/000001.txt");
    let less = |text: String| text.lines().skip(1).map(|l| format!("{l}\n")).collect();
    with(&label, less, || {
        let fault = place.fault("run", &steps);
        assert!(fault.contains("expected a run with"), "{fault}");
    });
    fs::remove_file(place.path("run/checkpoint.safetensors")).expect("removed");
    let fault = place.fault("run", &steps);
    assert!(
        fault.contains("model.safetensors: expected no file of another run"),
        "{fault}"
    );
    assert_eq!(place.model("run"), model);

    fs::create_dir_all(place.path("busy")).expect("a folder");
    let lock = File::create(place.path("busy/.lock")).expect("a file");
    lock.lock().expect("taken");
    let fault = place.fault("busy", &steps);
    assert!(fault.contains("another run"), "{fault}");
}

#[test]
fn a_model_that_was_worked_on_since_stays_as_it_is() {
    let place = Place::new();
    let steps = ["--steps", "2"];
    succeeds(&place.train("run", &steps).output().expect("started"));
    let path = place.path("run/model.safetensors");
    let mut model = Model::read(&path).expect("a model");
    model.manifest.provenance.threshold_choice = "chosen by hand".into();
    let bytes = model_bytes(&model.manifest, &model.weights).expect("a model");
    fs::write(&path, &bytes).expect("written");
    let output = place.train("run", &steps).output().expect("started");
    succeeds(&output);
    assert!(String::from_utf8_lossy(&output.stderr).contains("it stays as it is"));
    assert_eq!(place.model("run"), bytes);
    let fault = place.fault("run", &["--steps", "1"]);
    assert!(
        fault.contains("expected a run of at most 1 steps"),
        "{fault}"
    );

    // What is asked of a model that it cannot give is told before the scans are gone through.
    let mut command = Command::new(LAB);
    command.args([
        "evaluate", "method", "--method", "naive", "--data", "nowhere", "--model",
    ]);
    let output = command.arg(&path).output().expect("started");
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(
        text.contains("naive: expected a model with a Softmax head"),
        "{text}"
    );
}

#[test]
fn osis_is_trained_once_and_over_nothing() {
    let place = Place::new();
    let softmax = ["--network", "softmax", "--steps", "1"];
    succeeds(&place.train("softmax", &softmax).output().expect("started"));
    let init = place.path("softmax").display().to_string();
    let osis = ["--network", "osis", "--init", &init, "--steps", "2"];
    // What another run wrote into a log of this name is kept.
    fs::create_dir_all(place.path("osis")).expect("a folder");
    fs::write(place.path("osis/train.jsonl"), "old\n").expect("written");
    succeeds(&place.train("osis", &osis).output().expect("started"));
    let old = fs::read_to_string(place.path("osis/train.old.jsonl"));
    assert_eq!(old.expect("kept"), "old\n");
    let model = place.model("osis");
    let again = place.train("osis", &osis).output().expect("started");
    assert!(String::from_utf8_lossy(&again.stderr).contains("already trained"));
    let fault = place.fault("osis", &[&osis[..], &["--seed", "2"]].concat());
    assert!(fault.contains("expected no file of another run"), "{fault}");
    let fault = place.fault("softmax", &osis);
    assert!(fault.contains("expected no file of another run"), "{fault}");
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
    let text = String::from_utf8_lossy(&output.stderr);
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
    let full = || {
        File::options()
            .write(true)
            .open("/dev/full")
            .expect("there")
    };
    let mut command = place.train("run", &["--steps", "1"]);
    let status = command.stderr(full()).stdout(Stdio::null()).status();
    assert!(status.expect("started").success());
    assert!(!place.model("run").is_empty());
    // The answer itself has to arrive; that it did not is no panic.
    let mut command = place.train("other", &["--steps", "1"]);
    let output = command.stdout(full()).output().expect("started");
    let text = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{text}");
    assert!(text.contains("standard output"), "{text}");
}
