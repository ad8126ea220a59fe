//! An external program in the refiner's place: started by command, replaced by hand, alive over several runs. No message from
//! it, however wrong, stops the pipeline's output.

use mluc_tests::{
    Running, Setting, cpp_example, leftovers, mluc_program, python_example, python_script, root,
    send_signal,
};
use rustix::process::Signal;
use std::{process::Command, time::Duration};

/// The example refiners that are installed.
fn foreign_refiners() -> Vec<Vec<String>> {
    [python_example("refiner"), cpp_example("refiner")].into_iter().flatten().collect()
}

#[test]
fn the_examples_pass_the_suite() {
    let setting = Setting::new("suite", 0);
    for command in foreign_refiners() {
        let mut suite = Command::new(mluc_program());
        suite.args(["refiner-test", "--patience-s", "20", "--model"]);
        suite.arg(&setting.model).arg("--").args(&command);
        let run = Running::start(&mut suite).finish_within(Duration::from_secs(300));
        assert_eq!(run.code, Some(0), "{}", run.text());
        assert!(run.text().contains("18 passed, 0 failed"), "{}", run.text());
    }
}

fn config(setting: &Setting, command: &[String]) -> String {
    setting.config(&format!("[stages.refiner]\ncommand = {command:?}\n"))
}

#[test]
fn a_killed_or_stopped_foreign_refiner_is_started_again() {
    let setting = Setting::new("killed", 40);
    let each = foreign_refiners().into_iter();
    for (command, signal) in each.flat_map(|c| [(c.clone(), Signal::KILL), (c, Signal::STOP)]) {
        let mut run = setting.up(&config(&setting, &command));
        run.wait_for_lines(3);
        let victim = run.children_with(command.last().unwrap());
        assert_eq!(victim.len(), 1, "{command:?}: {victim:?}");
        // Three heartbeats: by then the supervisor knows that the refiner has published.
        std::thread::sleep(Duration::from_millis(300));
        send_signal(victim[0], signal);
        let run = setting.finish(run);
        run.assert_complete(3, 40);
        run.assert_says(&["0 lost; stages restarted: 1"]);
    }
}

#[test]
fn a_scan_that_kills_a_foreign_refiner_twice_is_set_aside() {
    let Some(example) = python_example("refiner") else {
        return;
    };
    let setting = Setting::new("poison", 5);
    let script = root().join("tests/tests/foreign_refiners/poisoned.py");
    let [python, example] = &example[..] else {
        panic!("{example:?}");
    };
    let words = [python, &script.display().to_string(), example];
    let command = words.map(String::clone);
    let run = setting.run(&config(&setting, &command));
    run.assert_says(&["set aside, because stages died of them: 1 (000002)"]);
    let flags = run.flags("000002");
    assert!(flags.contains(&"empty"), "{flags:?}");
    assert!(!run.flags("000004").contains(&"empty"));
}

/// A pipeline whose refiner is started by hand: the pipeline creates the instance that the refiner joins.
fn up_without_refiner(setting: &Setting, options: &str) -> Running {
    let mut run = setting.up(&format!("--without refiner {options}"));
    run.wait_for_words("refiner is left to you");
    run
}

#[test]
fn a_refiner_is_replaced_by_hand_while_the_others_run() {
    let setting = Setting::new("by-hand", 3);
    let mut run = up_without_refiner(&setting, "--loop");
    run.wait_until("three stages run", |run| run.stages().len() == 3);
    let others = run.stages();
    std::thread::sleep(Duration::from_millis(300));
    assert_eq!(run.line_count(), 0, "no refiner, no objects");

    let [program, model] = [&mluc_program(), &setting.model].map(|path| path.display().to_string());
    let ours = [&program, "stage", "refiner", "--model", &model].map(str::to_string);
    let mut commands = foreign_refiners();
    commands.insert(0, ours.to_vec());
    commands.push(ours.to_vec());
    for command in commands {
        let refiner = setting.start_by_hand(&command);
        run.wait_for_lines(4);
        refiner.stop();
    }
    assert_eq!(run.stages(), others, "nobody else was restarted");
    let run = setting.stop(run);
    let sequences = run.sequences();
    assert!(sequences.windows(2).all(|pair| pair[1] == pair[0] + 1), "{sequences:?}");
}

/// A refiner that stays joins run after run: the last messages of the earlier run are not used.
#[test]
fn a_refiner_that_outlives_three_runs_loses_no_frame() {
    for command in foreign_refiners() {
        let setting = Setting::new("outlives", 22);
        let first = up_without_refiner(&setting, "");
        let refiner = setting.start_by_hand(&command);
        let mut runs = vec![first.finish()];
        for _ in 1..3 {
            runs.push(setting.up("--without refiner").finish());
        }
        let log = refiner.stop().log;
        runs.iter().for_each(|run| run.assert_complete(0, 22));
        assert!(!log.contains("message refused"), "{log}");
        assert_eq!(leftovers(&setting.instance), [""; 0], "it leaves last");
    }
}

/// Before each answer this refiner sends sequences that were never sent or go back, and messages of another run, model and version.
#[test]
fn hostile_sequences_silence_nobody() {
    let Some(mut command) = python_script("tests/contract/tests/wrong_refiner.py") else {
        return;
    };
    command.push("hostile".to_string());
    let setting = Setting::new("hostile", 6);
    let run = up_without_refiner(&setting, "");
    let refiner = setting.start_by_hand(&command);
    let run = run.finish();
    refiner.stop();
    run.assert_complete(0, 6);
    run.assert_says(&["6 in, 6 out, 0 lost", "message refused: objects: sequence"]);
    assert_eq!(leftovers(&setting.instance), [""; 0]);
}
