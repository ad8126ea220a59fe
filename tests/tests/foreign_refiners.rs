//! Other programs in the refiner's place: by command, and by hand while the other stages run.

use std::process::{Child, Command, Stdio};
use std::time::Duration;

use mluc_tests::{
    Setting, built_program, cpp_refiner, leftovers, mluc_program, python_refiner, send_signal,
};
use rustix::process::Signal;

/// Those that are there: the one of the tests always.
fn foreign_refiners() -> Vec<(&'static str, Vec<String>)> {
    let own = vec![
        built_program("examples/wrong_refiner")
            .display()
            .to_string(),
        "sound".to_string(),
    ];
    let mut all = vec![("rust", own)];
    all.extend(python_refiner().map(|command| ("python", command)));
    all.extend(cpp_refiner().map(|command| ("cpp", command)));
    all
}

/// Of the test in which a refiner outlives runs.
const SCANS: usize = 22;

fn passes_the_suite(command: &[String]) {
    let setting = Setting::new("suite", 0);
    let output = Command::new(mluc_program())
        .args(["refiner-test", "--patience-s", "20", "--model"])
        .arg(&setting.model)
        .arg("--")
        .args(command)
        .output()
        .expect("mluc starts");
    let report = String::from_utf8_lossy(&output.stdout);
    assert_eq!(output.status.code(), Some(0), "{report}");
    assert!(report.contains("18 passed, 0 failed"), "{report}");
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

fn config(setting: &Setting, command: &[String]) -> String {
    setting.config(&format!("[stages.refiner]\ncommand = {command:?}\n"))
}

#[test]
fn a_foreign_refiner_is_started_by_its_command() {
    let setting = Setting::new("command", 5);
    for (name, command) in foreign_refiners() {
        let run = setting.run(&["--config", &config(&setting, &command)]);
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
    }
}

#[test]
fn a_killed_foreign_refiner_is_started_again() {
    let setting = Setting::new("killed", 40);
    for (name, command) in foreign_refiners() {
        let mut run = setting.up(&["--config", &config(&setting, &command)]);
        run.wait_until("frames flow", |p| p.line_count() > 2);
        let word = command.last().unwrap().clone();
        let victim = run.children_with(&word);
        assert_eq!(victim.len(), 1, "{name}: {victim:?}");
        send_signal(victim[0], Signal::KILL);
        let run = setting.finish(run);
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
    let setting = Setting::new("by-hand", 3);
    let mut run = setting.up(&["--loop", "--without", "refiner"]);
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
        setting.instance.clone(),
    ]
    .to_vec();
    let mut commands = vec![("ours", ours.clone())];
    commands.extend(foreign_refiners());
    commands.push(("ours again", ours));
    for (name, command) in commands {
        let before = run.line_count();
        let refiner = ByHand::start(&setting.instance, &command);
        run.wait_until(name, |p| p.line_count() >= before + 4);
        refiner.end();
    }
    assert_eq!(run.stages(), others, "nobody else was restarted");
    run.signal(Signal::TERM);
    let run = setting.finish(run);
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
}

/// One that stays joins run after run: the last messages of the run before are nobody's any more.
#[test]
fn a_refiner_that_outlives_three_runs_loses_no_frame() {
    for (name, command) in foreign_refiners() {
        let setting = Setting::new("outlives", SCANS);
        // Somebody must make the instance before a refiner can join it.
        let mut first = setting.up(&["--without", "refiner"]);
        first.wait_until("it says how", |p| {
            p.log().contains("refiner is left to you")
        });
        let refiner = ByHand::start(&setting.instance, &command);
        let mut runs = vec![first.finish()];
        for _ in 1..3 {
            runs.push(setting.up(&["--without", "refiner"]).finish());
        }
        refiner.end();
        for run in &runs {
            assert_eq!(
                (run.code, run.lines.len()),
                (Some(0), SCANS),
                "{name}: {}",
                run.log
            );
        }
        assert_eq!(leftovers(&setting.instance), [""; 0], "{name} leaves last");
    }
}
