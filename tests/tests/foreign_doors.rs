//! External programs at both ends: a source in ingest's place and consumers, the examples in Python and C++.

use mluc_tests::{Running, Setting, cpp_example, leftovers, python_example, send_signal};
use rustix::process::Signal;
use serde_json::Value;
use std::collections::HashMap;

/// Published objects by the frame's name or number.
fn objects<'a>(lines: &'a [Value], key: &str) -> HashMap<String, &'a Vec<Value>> {
    let objects = |line: &'a Value| Some((line[key].to_string(), line["objects"].as_array()?));
    lines.iter().filter_map(objects).collect()
}

#[test]
fn sources_and_consumers_of_ones_own_stand_in_for_ours() {
    for source in [python_example("source"), cpp_example("source")] {
        source.iter().for_each(|source| stands_in(source));
    }
}

fn stands_in(source: &[String]) {
    let setting = Setting::new("doors", 40);
    let scans = setting.input.display().to_string();
    let ours = setting.run("");
    let command = [source, &[scans]].concat();
    let config = setting.config(&format!("[stages.ingest]\ncommand = {command:?}\n"));
    let mut run = setting.up(&format!("{config} --pace sensor"));
    let consumers = [python_example("consumer"), cpp_example("consumer")];
    let consumers = consumers.into_iter().flatten().map(|words| setting.start_by_hand(&words));
    let mut consumers: Vec<Running> = consumers.collect();
    run.wait_for_lines(3);
    for consumer in &mut consumers {
        consumer.wait_for_lines(3);
    }
    // The next source continues after the scans that were sent.
    let sources = run.children_with(source.last().expect("a word"));
    send_signal(sources[0], Signal::KILL);
    let run = run.finish();
    run.assert_ended_well();
    run.assert_says(&["stages restarted: 1"]);
    assert!(!run.log.contains("refused"), "{}", run.log);
    let consumers: Vec<_> = consumers.into_iter().map(Running::stop).collect();
    assert_eq!(leftovers(&setting.instance), [""; 0]);

    let sequences = run.sequences();
    assert!(sequences.is_sorted() && sequences.last() == Some(&39), "{sequences:?}");
    let (expected, found) = (objects(&ours.lines, "frame"), objects(&run.lines, "frame"));
    for (frame, objects) in &found {
        assert_eq!(expected[frame], *objects, "{frame}");
    }
    let all = objects(&run.lines, "sequence");
    let points = |objects: &[Value]| objects.iter().map(|o| o["points"].as_u64()).collect();
    for consumer in consumers {
        let mut whole = 0;
        for (sequence, objects) in &objects(&consumer.lines, "sequence") {
            let [expected, found]: [Vec<_>; 2] = [all[sequence], *objects].map(|o| points(o));
            // The scan of its first frame was sent before the consumer joined.
            let is_gone = found == vec![Some(0); expected.len()];
            assert!(is_gone || found == expected, "{sequence}: {found:?}");
            whole += usize::from(!is_gone);
        }
        assert!(whole >= 2, "{}", consumer.text());
    }
}
