//! SIGHUP and `mluc reload`: other thresholds while the pipeline runs.

use mluc_tests::{Running, Setting};
use rustix::process::Signal;

#[test]
fn all_stages_take_new_thresholds_from_one_frame_on_and_wrong_ones_change_nothing() {
    let setting = Setting::new("reload", 3);
    let mut run = setting.up(&format!("--loop {}", setting.config("")));
    run.wait_for_lines(1);
    // The last ones: no candidates, and no known object published.
    for (text, code, words) in [
        ("min_score = 2.0", 2, "min_score must be 0 to 1, found 2"),
        ("unknown_min = 0.5", 2, "unknown_min: expected a model with"),
        (
            "stages.head.threads = 2",
            2,
            "stages.head.threads cannot change",
        ),
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
    run.signal(Signal::TERM);
    let run = setting.finish(run);
    run.assert_complete(0, run.lines.len() as u64);
    let (_, from) = run
        .log
        .split_once("reload: from frame ")
        .expect("waited for");
    let from: u64 = from.split(' ').next().unwrap().parse().expect("a frame");
    for (sequence, line) in run.sequences().into_iter().zip(&run.lines) {
        let is_published = line["objects"] != serde_json::json!([]);
        let has_unknown = line.to_string().contains("\"unknown\"");
        assert_eq!(
            [is_published, has_unknown],
            [sequence < from; 2],
            "frame {sequence} of {from}"
        );
    }
}
