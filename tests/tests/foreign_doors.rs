//! Somebody else's program at both ends: a source in ingest's place and a consumer, the examples in Python.

use std::collections::HashMap;
use std::process::Command;

use mluc_tests::{Running, Setting, leftovers, python_example, send_signal};
use rustix::process::Signal;
use serde_json::Value;

/// Published objects by the frame's name or number.
fn objects<'a>(lines: &'a [Value], key: &str) -> HashMap<String, &'a Vec<Value>> {
    let objects = |line: &'a Value| Some((line[key].to_string(), line["objects"].as_array()?));
    lines.iter().filter_map(objects).collect()
}

#[test]
fn a_source_and_a_consumer_in_python_stand_in_for_ours() {
    let Some(source) = python_example("source") else {
        return;
    };
    let setting = Setting::new("doors", 40);
    let scans = setting.input.display().to_string();
    let ours = setting.run("");
    let config = setting.config(&format!(
        "[stages.ingest]\ncommand = {:?}\n",
        [&source[..], &[scans]].concat()
    ));
    let mut run = setting.up(&format!("{config} --pace sensor"));
    let mut consumer = Command::new(&source[0]);
    consumer.args(&python_example("consumer").unwrap()[1..]);
    let mut consumer = Running::start(consumer.env("MLUC_INSTANCE", &setting.instance));
    run.wait_for_lines(3);
    consumer.wait_for_lines(3);
    // Its successor goes on behind the scans that were sent.
    send_signal(run.children_with(&source[1])[0], Signal::KILL);
    let run = run.finish();
    // 3: a loaded machine lost frames.
    assert!(matches!(run.code, Some(0 | 3)), "{}", run.log);
    run.assert_says(&["stages restarted: 1"]);
    assert!(!run.log.contains("refused"), "{}", run.log);
    let consumer = consumer.stop();
    assert_eq!(leftovers(&setting.instance), [""; 0]);

    let sequences = run.sequences();
    assert!(
        sequences.is_sorted() && *sequences.last().unwrap() == 39,
        "{sequences:?}"
    );
    let (expected, found) = (objects(&ours.lines, "frame"), objects(&run.lines, "frame"));
    for (frame, objects) in &found {
        assert_eq!(expected[frame], *objects, "{frame}");
    }
    let (all, seen) = (
        objects(&run.lines, "sequence"),
        objects(&consumer.lines, "sequence"),
    );
    let points = |objects: &[Value]| objects.iter().map(|o| o["points"].as_u64()).collect();
    let mut whole = 0;
    for (sequence, objects) in &seen {
        let [expected, found]: [Vec<_>; 2] = [all[sequence], *objects].map(|o| points(o));
        // The scan of its first frame was sent before it joined.
        let is_gone = found == vec![Some(0); expected.len()];
        assert!(is_gone || found == expected, "{sequence}: {found:?}");
        whole += usize::from(!is_gone);
    }
    assert!(whole >= 2, "{}", consumer.text());
}
