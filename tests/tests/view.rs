//! `mluc record` and `mluc view` next to a running pipeline; packages of other projects read their output (`view/check.py`).

use mluc_sources::{Next, Scan, Source, files::Layout};
use mluc_tests::{Running, Setting, mluc_program, python_example, root, write_file};
use rustix::process::Signal;
use std::process::Command;

#[test]
fn a_recording_and_a_socket_tell_what_the_pipeline_told() {
    let Some(python) = python_example("consumer") else {
        return;
    };
    let check = |words: [&str; 3]| {
        let script = root().join("tests/tests/view/check.py");
        let checked = Running::start(Command::new(&python[0]).arg(script).args(words)).finish();
        assert_eq!(checked.code, Some(0), "{}", checked.log);
    };
    let setting = Setting::new("view", 4);
    // Both programs start before the pipeline.
    let (record, out) = setting.start_record("run.mcap", "");
    let mut view = Command::new(mluc_program());
    view.args("view --port 0 --log-format json".split(' '));
    let mut view = Running::start(view.env("MLUC_INSTANCE", &setting.instance));
    let address = view.wait_for_address("is the page");

    // Both programs outlive a pipeline.
    let mut lines = String::new();
    for _ in 0..2 {
        let config = setting.config("[sensor]\nextrinsics = [0.5, 0.0, 1.0, 0.0, 0.0, 0.0]\n");
        let mut run = setting.up(&format!("{config} --pace sensor --rate 5 --loop"));
        run.wait_for_lines(3);
        check(["socket", &address, ""]);
        let run = run.stop();
        lines.extend(run.lines.iter().map(|line| format!("{line}\n")));
    }
    // Eight per pipeline: another site's page, another protocol, a request that is no HTTP, four texts and bytes that are no valid request.
    view.stop().assert_says(&["a binary message", r#""refused":"16""#]);
    record.signal(Signal::TERM);
    setting.finish(record).assert_ended_well();

    let told = setting.folder.path().join("lines.jsonl");
    write_file(&told, lines);
    check(["file", &out, &told.display().to_string()]);
    let scan = |number: usize| std::fs::read(setting.input.join(format!("{number:06}.bin")));
    let scans: Vec<Vec<u8>> = (0..4).map(|number| scan(number).expect("a scan")).collect();
    let (mut scan, mut count) = (Scan::default(), 0);
    let mut source = Source::open(out.as_ref(), &Layout::default(), false).expect("a recording");
    while let next @ (Next::Scan | Next::NotYet) = source.load(count, &mut scan).expect("sound") {
        assert!(scans.contains(&scan.bytes), "the points of scan {count}");
        count += u64::from(next == Next::Scan);
    }
    assert!(count >= 6, "{count} scans");
    // A replay gives the same objects, and other objects with another threshold.
    let model = setting.model.display();
    let replay = |options: &str| setting.replay(&out, &format!("--model {model} {options}"));
    let same = replay("");
    same.assert_ended(0, 0);
    let words = format!("frames: {count} with the recorded objects, 0 with others");
    same.assert_says(&[&words]);
    let other = replay("--profile quiet --min-score 0.99");
    assert_eq!(other.code, Some(1), "{}", other.log);
    assert_eq!(other.lines.len() as u64, count, "{}", other.log);
}
