//! `mluc-lab train`: errors are named, finished work is kept.

use crate::{Folder, text};
use mluc_model::{Model, model_bytes};
use mluc_reproduce::{RunState, run_state};
use std::{fs, fs::File, process::Command, process::Stdio, time::Duration};

/// A folder with four simulated scans in `data/train`.
fn place() -> Folder {
    let place = Folder::new();
    place.run("simulate --family sim-kitti --split train --frames 4 --seed 3 --out data/train");
    place
}

/// The words of a command that trains on these scans, into `run`.
fn train(run: &str, more: &str) -> String {
    format!("train --setting kitti --batch 1 --validate-frames 0 --data data --out {run} {more}")
}

impl Folder {
    fn trainer(&self, run: &str, more: &str) -> Command {
        self.command(&train(run, more))
    }

    /// Trains to the end; returns the program's messages.
    #[track_caller]
    fn trained(&self, run: &str, more: &str) -> String {
        text(&self.run(&train(run, more)).stderr)
    }

    #[track_caller]
    fn refuses_to_train(&self, run: &str, more: &str, words: &[&str]) {
        self.refuses(&train(run, more), words);
    }

    fn model(&self, run: &str) -> Vec<u8> {
        self.read(&format!("{run}/model.safetensors"))
    }
}

const ONE: &str = "--steps 1";

#[test]
fn wrong_data_is_named_before_anything_is_trained() {
    let place = place();
    let misspelt = |bytes: &[u8]| text(bytes).replacen("Car ", "Carr ", 1).into();
    let negative = |bytes: &[u8]| {
        let text = text(bytes);
        let mut columns: Vec<&str> = text.split(' ').collect();
        columns[8] = "-1.5";
        columns.join(" ").into()
    };
    type Change<'a> = &'a dyn Fn(&[u8]) -> Vec<u8>;
    let label = "data/train/label_2/000001.txt";
    let class = "000001.txt, line|field type: expected one of Car, Van|found 'Carr'";
    let size = "000001.txt, line 1, field height|found '-1.5'";
    let cut = "000003.bin: expected a multiple of 16 bytes";
    let calib = "data/train/calib/000002.txt";
    let scan = "data/train/velodyne/000003.bin";
    let cases: [(&str, Change, &str); 4] = [
        (label, &misspelt, class),
        (label, &negative, size),
        (calib, &|_| b"P2: 1 2 3\n".into(), "000002.txt, line 1"),
        (scan, &|bytes| bytes[..bytes.len() - 7].into(), cut),
    ];
    for (file, change, words) in cases {
        let words: Vec<&str> = words.split('|').collect();
        place.with(file, change, || place.refuses_to_train("run", ONE, &words));
    }
    place.with(label, misspelt, || {
        place.trained("ignoring", "--steps 1 --ignore-classes carr");
    });
    place.refuses_to_train("threads", "--threads 1000000", &[]);
    assert!(!place.path("threads").exists());
}

#[test]
fn empty_scans_are_told_from_hard_ones() {
    let place = place();
    for name in ["000000", "000001", "000002", "000003"] {
        place.write(&format!("data/train/velodyne/{name}.bin"), []);
    }
    let fault = ["expected points in the labelled boxes"];
    place.refuses_to_train("run", "--steps 1", &fault);
}

#[test]
fn a_killed_run_goes_on_to_the_bits_of_an_uninterrupted_one() {
    let place = place();
    let steps = "--steps 8 --checkpoint-every 1";
    place.trained("whole", steps);

    let mut child = place.trainer("cut", steps).stderr(Stdio::null()).spawn().expect("started");
    let checkpoint = place.path("cut/checkpoint.safetensors");
    mluc_tests::wait_for(Duration::from_secs(60), || checkpoint.exists());
    child.kill().expect("killed");
    child.wait().expect("ended");
    let cut = run_state(&place.path("cut")).expect("a run");
    assert_ne!(cut, RunState::Done, "it was interrupted");
    // The log may end in the middle of a line.
    place.write("cut/train.jsonl", "{\"step\":1,\"ste");
    place.trained("cut", steps);
    assert_eq!(place.model("cut"), place.model("whole"));
    let state = || run_state(&place.path("cut")).expect("a run");
    assert_eq!(state(), RunState::Done);

    // The log names more steps than were done: the run is not at its end.
    place.write("cut/train.jsonl", "{\"step\":9,\"steps\":9}\n");
    assert_eq!(state(), RunState::Unfinished { step: 8, steps: 9 });
}

#[test]
fn a_run_writes_over_nothing_that_is_not_its_own() {
    let place = place();
    place.trained("run", ONE);
    let model = place.model("run");

    let other_run = ["checkpoint.safetensors: expected a run with"];
    place.refuses_to_train("run", "--steps 1 --seed 2", &other_run);
    // Other labels under the same name make other data.
    let less = |bytes: &[u8]| {
        bytes.splitn(2, |byte| *byte == b'\n').nth(1).expect("a second line").to_vec()
    };
    place.with("data/train/label_2/000001.txt", less, || {
        place.refuses_to_train("run", ONE, &["expected a run with"]);
    });
    fs::remove_file(place.path("run/checkpoint.safetensors")).expect("removed");
    let other_file = ["model.safetensors: expected no file of another run"];
    place.refuses_to_train("run", ONE, &other_file);
    assert_eq!(place.model("run"), model);

    place.write("busy/.lock", "");
    let lock = File::create(place.path("busy/.lock")).expect("a file");
    lock.lock().expect("taken");
    place.refuses_to_train("busy", ONE, &["another run"]);
}

#[test]
fn a_model_that_was_worked_on_since_stays_as_it_is() {
    let place = place();
    let steps = "--steps 2";
    place.trained("run", steps);
    let mut model = Model::from_bytes(&place.model("run")).expect("a model");
    for choices in [["by hand", ""], ["", "by hand"]] {
        let from = &mut model.manifest.provenance;
        [from.threshold_choice, from.profile_choice] = choices.map(str::to_owned);
        let bytes = model_bytes(&model.manifest, &model.weights).expect("a model");
        place.write("run/model.safetensors", &bytes);
        assert!(place.trained("run", steps).contains("it stays as it is"));
        assert_eq!(place.model("run"), bytes);
    }
    place.refuses_to_train("run", ONE, &["expected a run of at most 1 steps"]);
}

#[test]
fn osis_is_trained_once_and_over_nothing() {
    let place = place();
    place.trained("softmax", "--network softmax --steps 1");
    let osis = "--network osis --init softmax --steps 2";
    // The log of another run with this name is kept.
    place.write("osis/train.jsonl", "old\n");
    place.trained("osis", osis);
    assert_eq!(place.read("osis/train.old.jsonl"), b"old\n");
    let model = place.model("osis");
    assert!(place.trained("osis", osis).contains("already trained"));
    let other_file = ["expected no file of another run"];
    place.refuses_to_train("osis", &format!("{osis} --seed 2"), &other_file);
    place.refuses_to_train("softmax", osis, &other_file);
    assert_eq!(place.model("osis"), model);
}

#[test]
fn a_full_terminal_stops_nothing() {
    let place = place();
    let full = || File::create("/dev/full").expect("there");
    let mut command = place.trainer("run", ONE);
    let status = command.stderr(full()).stdout(Stdio::null()).status();
    assert!(status.expect("started").success());
    assert!(!place.model("run").is_empty());
    // The answer itself must arrive. If it does not, the program ends with an error and without a panic.
    let output = place.trainer("other", ONE).stdout(full()).output().expect("started");
    let text = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{text}");
    assert!(text.contains("standard output"), "{text}");
}
