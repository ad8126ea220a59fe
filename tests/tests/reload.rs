//! SIGHUP and `mluc reload`: other thresholds while the pipeline runs.

use mluc_tests::{Running, Setting, mluc_program, root, send_signal};
use rustix::process::Signal;
use std::{collections::HashMap, process::Command};

#[test]
fn all_stages_take_new_thresholds_from_one_frame_on_and_wrong_ones_change_nothing() {
    let setting = Setting::new("reload", 3);
    let mut run = setting.up(&format!("--loop {}", setting.config("")));
    run.wait_for_lines(1);
    // As `systemctl kill` does it: to all processes. The stages ignore it.
    run.stages().into_iter().for_each(|(_, pid)| send_signal(pid, Signal::HUP));
    // The last two cases leave no candidates and no published known object.
    for (text, code, words) in [
        ("min_score = 2.0", 2, "min_score must be 0 to 1, found 2"),
        ("unknown_min = 0.5", 2, "unknown_min: expected a model with"),
        ("stages.head.threads = 3", 2, "threads cannot change"),
        ("lambda = 0.0\nmin_score = 1.0", 0, "on: lambda, min_score"),
        ("min_score = 1.0\nlambda = 0.0", 0, "nothing has changed"),
    ] {
        setting.config(text);
        run.wait_for_lines(2);
        let asked = Running::mluc(["reload", "--instance", &setting.instance]).finish();
        assert_eq!(asked.code, Some(code), "{text}: {}", asked.log);
        run.wait_for_words(words);
    }
    run.wait_for_lines(3);
    let run = setting.stop(run);
    run.assert_complete(0, run.lines.len() as u64);
    run.assert_says(&["stages restarted: 0"]);
    let (_, from) = run.log.split_once("reload: from frame ").expect("waited for");
    let from: u64 = from.split(' ').next().unwrap().parse().expect("a frame");
    for (sequence, line) in run.sequences().into_iter().zip(&run.lines) {
        let is_published = line["objects"] != serde_json::json!([]);
        let has_unknown = line.to_string().contains("\"unknown\"");
        let is_old = [sequence < from; 2];
        assert_eq!([is_published, has_unknown], is_old, "frame {sequence}");
    }
}

#[test]
fn another_model_takes_over_between_two_frames_and_one_that_does_not_fit_changes_nothing() {
    let setting = Setting::new("model", 3);
    let put = |name: &str| {
        let weights = root().join(format!("weights/{name}.safetensors"));
        std::fs::copy(weights, &setting.model).expect("a shipped model");
    };
    put("paper/kitti-open");
    let program = mluc_program().with_file_name(&setting.instance);
    std::fs::hard_link(mluc_program(), &program).expect("the same folder");
    let mut command = Command::new(&program);
    let mut run = Running::start(command.args(setting.up_command("--loop").get_args()));
    std::fs::remove_file(&program).expect("it was there");
    for name in "paper/kitti any paper/kitti-open paper/udi paper/kitti any".split(' ') {
        run.wait_for_lines(3);
        put(name);
        let before = run.line_count();
        let asked = Running::mluc(["reload", "--instance", &setting.instance]).finish();
        // The other models have a larger map, or more classes.
        let code = if name.contains("kitti") { 0 } else { 2 };
        assert_eq!(asked.code, Some(code), "{name}: {}", asked.log);
        // Frames still came while the model was loaded.
        assert!(code == 2 || run.line_count() >= before + 3, "{}", run.log());
    }
    // A restarted stage works even though the files of model and program have changed or are gone.
    send_signal(run.stage("head"), Signal::KILL);
    run.wait_for_lines(5);
    let run = setting.stop(run);
    run.assert_complete(0, run.lines.len() as u64);
    let mut models: Vec<_> = run.lines.iter().map(|line| &line["model"]).collect();
    models.dedup();
    assert_eq!(models, [models[0], models[1], models[0], models[1]]);
    // The same model always gives the same objects for a scan: no frame mixes two models.
    let mut objects = HashMap::new();
    for line in &run.lines {
        let frame = ["frame", "model"].map(|key| line[key].as_str());
        let found = [&line["objects"], &line["suppressed"]];
        assert_eq!(*objects.entry(frame).or_insert(found), found);
    }
}
