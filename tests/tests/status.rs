//! What the status tells a consumer when no objects come: nothing is there, the sensor is blind, results are late, or the pipeline has stopped.

use mluc_ipc_types::{Status, StatusState};
use mluc_runtime::StatusWatch;
use mluc_tests::{
    Finished, Running, Setting, assert_has, car_scan, python_example, root, wait_for,
};
use procfs::process::Process;
use rustix::process::Signal;
use serde_json::{Value, json};
use std::{process::Command, time::Duration};

const PATIENCE: Duration = Duration::from_secs(30);

/// Waits for a status that fulfils `is_it`.
#[track_caller]
fn wait(run: &Running, watch: &mut StatusWatch, is_it: impl Fn(&Status) -> bool) -> Status {
    let mut last = None;
    let mut look = || {
        last = watch.update().unwrap();
        last.is_some_and(|status| is_it(&status))
    };
    assert!(wait_for(PATIENCE, &mut look), "{last:?} {}", run.log());
    last.unwrap()
}

fn is(state: StatusState) -> impl Fn(&Status) -> bool {
    move |status| status.checked() == Ok(state)
}

/// States and reasons of the status lines.
fn told(run: &Finished) -> Vec<[&str; 2]> {
    let statuses = run.lines.iter().filter_map(|line| line.get("status"));
    statuses.map(|s| ["state", "reason"].map(|key| s[key].as_str().unwrap_or("?"))).collect()
}

#[test]
fn a_stage_that_stops_is_told_by_the_clock_and_so_is_the_supervisor() {
    let setting = Setting::new("stopped", 3);
    let never = setting.config("[stages.refiner]\nheartbeat_max_ms = 0\nbudget_ms = 500\n");
    let options = format!("{never} --pace sensor --rate 5 --budget-ms 1000 --loop --status-lines");
    let mut run = setting.up(&options);
    run.wait_for_lines(3);
    let shell = setting.observer();
    let mut watch = shell.status_watch().unwrap();
    let sees = |status: &Status| status.checked().is_ok_and(StatusState::sees);
    let good = wait(&run, &mut watch, sees);
    assert!(good.frames_out > 0 && good.age_ns < 10_000_000_000, "{good:?}");
    if let Some(command) = python_example("refiner") {
        let words =
            "import mluc\nw = mluc.Watch()\nwhile w.status() is None: pass\nprint(w.status()[0])";
        let mut python = Command::new(&command[0]);
        python.args(["-c", words]);
        python.current_dir(root().join("python"));
        python.env("MLUC_INSTANCE", &setting.instance);
        let said = Running::start(&mut python).finish();
        assert!(StatusState::NAMES.contains(&said.text().trim()), "{} {}", said.text(), said.log);
    }

    let refiner = run.stage("refiner");
    mluc_tests::send_signal(refiner, Signal::STOP);
    wait(&run, &mut watch, is(StatusState::Late));
    let stopped = wait(&run, &mut watch, is(StatusState::Stopped));
    assert!(stopped.age_ns > 2_000_000_000, "{stopped:?}");
    assert_eq!(stopped.reason(), "no results come: refiner is silent");
    // The limits depend on time: first a warning comes, then an error.
    for words in ["WARN", "ERROR"] {
        run.wait_until("the stage's budget is judged", |run| {
            let log = run.log();
            let mut lines = log.lines();
            lines.any(|line| line.contains(words) && line.contains("refiner publishes nothing"))
        });
    }
    mluc_tests::send_signal(refiner, Signal::CONT);
    let again = wait(&run, &mut watch, sees);
    assert!(again.sequence > stopped.sequence, "{again:?}");

    run.signal(Signal::STOP);
    let silent = wait(&run, &mut watch, is(StatusState::Stopped));
    assert_eq!(silent.reason(), "the supervisor hangs or is gone");
    run.signal(Signal::CONT);
    wait(&run, &mut watch, sees);
    drop((watch, shell));
    let run = setting.stop(run);
    let told = told(&run);
    let silent = "no results come: refiner is silent";
    for words in [["stopped", silent], ["stopped", "asked to end"]] {
        assert!(told.contains(&words), "{told:?}");
    }
    let is_frame = |line: &&Value| line.get("status").is_none();
    let frames: Vec<&Value> = run.lines.iter().filter(is_frame).collect();
    assert_eq!(frames.len(), run.sequences().len());
    // Dropped frames in the status are those that are missing on stdout and not in work at the end.
    let last = &run.lines.last().expect("lines")["status"];
    let [taken, out, dropped] = ["in", "out", "dropped"]
        .map(|way| last[format!("frames_{way}")].as_u64().unwrap_or_else(|| panic!("{last}")));
    let ends = run.sequences().last().expect("frames") + 1;
    assert_eq!((out, out + dropped), (frames.len() as u64, ends), "{last}");
    assert!(dropped > 0 && taken >= ends, "{last}");
    assert!(frames.iter().all(|line| line["state"].is_string()));
}

#[test]
fn a_covered_direction_a_covered_sensor_and_nothing_there_are_told_apart() {
    let setting = Setting::new("blind", 0);
    let whole = car_scan(9.0);
    // The first sector to the right of straight ahead.
    let covered = |p: &&[f32; 4]| !(-0.17..0.0).contains(&p[1].atan2(p[0]));
    let covered: Vec<[f32; 4]> = whole.iter().filter(covered).copied().collect();
    for number in 0..70 {
        let scan = match number {
            0..20 => &whole[..],
            20..45 => &covered,
            _ => &[],
        };
        setting.write_scan(&format!("{number:06}"), scan);
    }
    let run = setting.run("--pace sensor --rate 10 --budget-ms 5000 --status-lines");
    let told = told(&run);
    let has = |state: &str, start: &str| {
        told.iter().any(|[found, reason]| *found == state && reason.starts_with(start))
    };
    assert!(has("degraded", "1 of 10 directions"), "{told:?}");
    assert!(has("blind", ""), "{told:?}");
    assert_eq!(told.last(), Some(&["stopped", "the input ended"]));
    let lines = run.lines.iter();
    let blind_deg: Vec<&Value> = lines.map(|line| &line["status"]["blind_deg"]).collect();
    assert!(blind_deg.contains(&&json!([[350, 360]])), "{blind_deg:?}");
}

#[test]
fn missed_budgets_are_told_and_every_hop_adds_up() {
    let setting = Setting::new("budget", 20);
    let config = setting.config("[stages.backbone]\nbudget_ms = 0\n");
    let run = setting.run(&format!("{config} --status-lines --log-format json"));
    let last = run.lines.last().expect("lines");
    let count = |key: &str| last["status"][key].clone();
    for key in ["frames_in", "frames_out"] {
        assert_eq!(count(key), 20, "{last}");
    }
    assert_eq!(count("stages_late")["backbone"], 20, "{last}");
    assert_eq!(count("stages_late")["head"], 0, "{last}");
    let (mut messages, mut has_error) = (Vec::new(), false);
    for line in run.log.lines() {
        let event: Value = serde_json::from_str(line).unwrap_or_else(|e| panic!("{e}: {line}"));
        for key in ["time", "level", "process"] {
            assert!(event[key].is_string(), "{line}");
        }
        let message = event["message"].as_str().unwrap_or_default();
        let is_lasting = message.contains("by 20 frames in a row");
        has_error |= is_lasting && event["level"] == "ERROR";
        messages.push(message.to_string());
    }
    let log = messages.join("\n");
    assert_has(&log, &["budget of backbone missed: ", "20 in, 20 out"]);
    assert!(has_error, "{log}");
    let rows = log.lines().skip_while(|line| !line.starts_with("frames   "));
    for row in rows.skip(1).take(5) {
        let numbers: Vec<u64> = row.split_whitespace().filter_map(|w| w.parse().ok()).collect();
        assert_eq!(numbers[..3], [20, 20, 0], "{log}");
    }
}

#[test]
fn what_a_stage_may_not_have_is_one_warning_and_what_it_may_have_holds() {
    let setting = Setting::new("rights", 3);
    let own = "cpus = [0]\npriority = 1\nlock_memory = true\nprefault = false";
    let config = setting.config(&format!("[stages.head]\n{own}\n"));
    let mut run = setting.up(&format!("{config} --pace sensor --rate 10 --loop"));
    run.wait_for_lines(3);
    let head = Process::new(run.stage("head") as i32).expect("it runs");
    // SCHED_FIFO.
    let is_real_time = head.stat().expect("it runs").policy == Some(1);
    let status = head.status().expect("it runs");
    let is_locked = status.vmlck.expect("VmLck") > 0;
    let is_pinned = status.cpus_allowed_list.expect("cores") == [(0, 0)];
    let run = setting.stop(run);
    let warnings = |words: &str| {
        run.log.lines().filter(|line| line.contains("WARN") && line.contains(words)).count()
    };
    for (words, has_it) in
        [("priority of head", is_real_time), ("lock_memory: ", is_locked), ("cpus: ", is_pinned)]
    {
        assert_eq!(warnings(words), usize::from(!has_it), "{}", run.log);
    }
    // The same warning for a stage that is started alone.
    let (model, instance) = (setting.model.display(), &setting.instance);
    let words = format!("stage head {config} --model {model} --instance {instance}");
    let mut alone = Running::mluc(words.split_whitespace());
    alone.wait_for_words("waiting for the run");
    let head = Process::new(alone.pid() as i32).and_then(|head| head.stat());
    assert_eq!(head.expect("it runs").policy == Some(1), is_real_time);
    assert_eq!(alone.log().contains("priority of head"), !is_real_time);
}
