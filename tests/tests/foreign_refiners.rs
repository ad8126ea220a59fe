//! Other programs in the refiner's place: by command, and by hand while the other stages run.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use mluc_tests::{
    Pipeline, clean_folder, cpp_refiner, leftovers, mluc_program, python_refiner, send_signal,
    unique_instance, untrained_model,
};
use rustix::process::Signal;

/// Those that are there: the one of the tests always.
fn foreign_refiners() -> Vec<(&'static str, Vec<String>)> {
    let own = vec![
        env!("CARGO_BIN_EXE_wrong_refiner").to_string(),
        "sound".to_string(),
    ];
    let mut all = vec![("rust", own)];
    all.extend(python_refiner().map(|command| ("python", command)));
    all.extend(cpp_refiner().map(|command| ("cpp", command)));
    all
}

fn passes_the_suite(command: &[String]) {
    let setting = setting(0);
    let output = Command::new(mluc_program())
        .args(["refiner-test", "--patience-s", "20", "--model"])
        .arg(&setting.model)
        .arg("--")
        .args(command)
        .output()
        .expect("mluc starts");
    let report = String::from_utf8_lossy(&output.stdout);
    assert_eq!(output.status.code(), Some(0), "{report}");
    assert!(report.contains("15 passed, 0 failed"), "{report}");
}

#[test]
fn the_python_example_passes_the_suite() {
    if let Some(command) = python_refiner() {
        passes_the_suite(&command);
    }
}

#[test]
fn the_cpp_example_passes_the_suite() {
    if let Some(command) = cpp_refiner() {
        passes_the_suite(&command);
    }
}

struct Setting {
    folder: tempfile::TempDir,
    model: PathBuf,
    input: PathBuf,
}

fn setting(scans: usize) -> Setting {
    let folder = tempfile::tempdir().unwrap();
    Setting {
        model: untrained_model(folder.path()),
        input: clean_folder(folder.path(), scans),
        folder,
    }
}

fn config(folder: &Path, command: &[String]) -> String {
    let path = folder.join("mluc.toml");
    let text = format!("[stages.refiner]\ncommand = {command:?}\n");
    std::fs::write(&path, text).unwrap();
    path.display().to_string()
}

#[test]
fn a_foreign_refiner_is_started_by_its_command() {
    let setting = setting(5);
    for (name, command) in foreign_refiners() {
        let config = config(setting.folder.path(), &command);
        let instance = unique_instance(name);
        let more = ["--pace", "complete", "--config", &config];
        let run = Pipeline::up(&instance, &setting.model, &setting.input, &more).finish();
        assert_eq!(
            (run.code, run.lines.len()),
            (Some(0), 5),
            "{name}: {}",
            run.log
        );
        for line in &run.lines {
            let count = |key: &str| line[key].as_array().map_or(0, Vec::len);
            let objects = count("objects") + count("suppressed");
            assert!(
                objects > 0,
                "{name}: the model has boxes in every frame: {line}"
            );
            assert!(
                !run.flags(line["frame"].as_str().unwrap())
                    .contains(&"points_gone"),
                "{name}: {line}"
            );
        }
        assert_eq!(leftovers(&instance), Vec::<String>::new(), "{name}");
    }
}

#[test]
fn a_killed_foreign_refiner_is_started_again() {
    let setting = setting(40);
    for (name, command) in foreign_refiners() {
        let config = config(setting.folder.path(), &command);
        let instance = unique_instance(name);
        let more = ["--pace", "complete", "--config", &config];
        let mut run = Pipeline::up(&instance, &setting.model, &setting.input, &more);
        run.wait_until("frames flow", |p| p.line_count() > 2);
        let word = command.last().unwrap().clone();
        let victim = run.children_with(&word);
        assert_eq!(victim.len(), 1, "{name}: {victim:?}");
        send_signal(victim[0], Signal::KILL);
        let run = run.finish();
        assert_eq!(
            (run.code, run.lines.len()),
            (Some(3), 40),
            "{name}: {}",
            run.log
        );
        assert!(
            run.log.contains("0 lost; stages restarted: 1"),
            "{name}: {}",
            run.log
        );
        assert_eq!(leftovers(&instance), Vec::<String>::new(), "{name}");
    }
}

/// A refiner that the test starts and ends.
struct ByHand(Child);

impl ByHand {
    fn start(instance: &str, command: &[String]) -> ByHand {
        let process = Command::new(&command[0])
            .args(&command[1..])
            .env("MLUC_INSTANCE", instance)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .spawn()
            .expect("the refiner starts");
        ByHand(process)
    }

    fn end(mut self) {
        send_signal(self.0.id(), Signal::TERM);
        let status = self.0.wait().expect("a child of ours");
        assert!(status.success(), "{status}");
    }
}

impl Drop for ByHand {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn a_refiner_is_replaced_by_hand_while_the_others_run() {
    let setting = setting(3);
    let instance = unique_instance("by-hand");
    let more = ["--pace", "complete", "--loop", "--without", "refiner"];
    let mut run = Pipeline::up(&instance, &setting.model, &setting.input, &more);
    run.wait_until("it says how", |p| {
        p.log().contains("refiner is left to you")
    });
    run.wait_until("three stages run", |p| p.stages().len() == 3);
    let others = run.stages();
    std::thread::sleep(Duration::from_millis(300));
    assert_eq!(run.line_count(), 0, "no refiner, no objects");

    let ours: Vec<String> = [
        mluc_program().display().to_string(),
        "stage".to_string(),
        "refiner".to_string(),
        "--model".to_string(),
        setting.model.display().to_string(),
        "--instance".to_string(),
        instance.clone(),
    ]
    .to_vec();
    let mut commands = vec![("ours", ours.clone())];
    commands.extend(foreign_refiners());
    commands.push(("ours again", ours));
    for (name, command) in commands {
        let before = run.line_count();
        let refiner = ByHand::start(&instance, &command);
        run.wait_until(name, |p| p.line_count() >= before + 4);
        refiner.end();
    }
    assert_eq!(run.stages(), others, "nobody else was restarted");
    run.signal(Signal::TERM);
    let run = run.finish();
    assert_eq!(run.code, Some(0), "{}", run.log);
    let sequences: Vec<u64> = run
        .lines
        .iter()
        .filter_map(|line| line["sequence"].as_u64())
        .collect();
    assert!(
        sequences.windows(2).all(|pair| pair[1] == pair[0] + 1),
        "{sequences:?}"
    );
    assert_eq!(leftovers(&instance), Vec::<String>::new());
}
