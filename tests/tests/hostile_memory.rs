//! Faulty shared memory: full, half-made, kept, rewritten after publication, or accessed by another user.

use mluc_ipc_types::{Object, Point, Topic};
use mluc_runtime::{Input, Instance, Message, Payload, Shell};
use mluc_tests::{Running, Setting, leftovers, send_signal, skip, wait_for};
use procfs::process::{MMapPath, MemoryMap, Process};
use rustix::process::{Signal, geteuid};
use std::{fs, fs::File, io::repeat, os::unix::fs::FileExt, os::unix::fs::MetadataExt};
use std::{process::Command, time::Duration, time::Instant};

/// A consumer of the pipeline's objects, which needs no model.
fn consumer(setting: &Setting) -> (Shell, Input<Object>) {
    let shell = setting.observer();
    let input = shell.input(&Topic::OBJECTS).unwrap();
    (shell, input)
}

fn next<T: Payload>(input: &mut Input<T>) -> Message<T> {
    let mut message = None;
    wait_for(Duration::from_secs(30), || {
        message = input.newest().unwrap();
        message.is_some()
    });
    message.expect("a message")
}

#[test]
fn a_consumer_that_keeps_what_it_gets_stops_nobody() {
    let setting = Setting::new("keeps", 2);
    let mut run = setting.up("--loop");
    run.wait_for_lines(1);
    let (shell, mut input) = consumer(&setting);
    let count = Topic::OBJECTS.borrowed;
    let kept: Vec<_> = (0..count).map(|_| next(&mut input)).collect();
    let sequences = || kept.iter().map(|message| message.header().sequence);
    let first: Vec<u64> = sequences().collect();
    run.wait_for_lines(20);
    assert!(input.newest().is_err(), "it may hold no more");
    assert!(sequences().eq(first));
    drop((kept, input, shell));
    setting.stop(run).assert_says(&[", 0 lost", "stages restarted: 0"]);
}

#[test]
fn a_third_consumer_of_points_is_refused_with_a_reason() {
    let setting = Setting::new("third", 2);
    let mut run = setting.up("--loop");
    run.wait_for_lines(1);
    let shell = setting.observer();
    let two = [(); 2].map(|()| shell.side_input::<Point>(&Topic::POINTS).unwrap());
    let out = setting.folder.path().join("run.mcap").display().to_string();
    let third = Running::mluc(["record", "--instance", &setting.instance, "--out", &out]).finish();
    third.assert_ended(1, 0);
    third.assert_says(&["topic points", "no place for another consumer"]);
    drop((two, shell));
    setting.stop(run);
}

/// Where the elements of a message are: the file and the offset in it.
fn place<T: Payload>(shell: &Shell, message: &Message<T>) -> (File, u64) {
    let inode = shell.segment_of(message.elements()).expect("shared memory");
    let start = message.elements().as_ptr() as u64;
    let maps = Process::myself().and_then(|own| own.maps()).unwrap();
    let is_it = |map: &MemoryMap| (map.address.0..map.address.1).contains(&start);
    let map = maps.into_iter().find(is_it).expect("a mapping");
    let MMapPath::Path(path) = map.pathname else { panic!("{map:?}") };
    let file = File::options().write(true).open(path).unwrap();
    assert_eq!(file.metadata().unwrap().ino(), inode);
    (file, start - map.address.0)
}

/// Overwrites published messages for a second.
fn rewrite<T: Payload>(shell: &Shell, input: &mut Input<T>) {
    let begun = Instant::now();
    let mut word = 1u64;
    while begun.elapsed() < Duration::from_secs(1) {
        let message = next(input);
        let bytes = size_of_val(message.elements()) as u64;
        if bytes < 8 {
            continue;
        }
        let (file, at) = place(shell, &message);
        for _ in 0..2000 {
            word = word.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            let offset = (word >> 33) % (bytes - 7);
            file.write_all_at(&word.to_ne_bytes(), at + offset).unwrap();
        }
    }
}

#[test]
fn objects_and_their_points_that_change_after_their_publication_harm_nobody() {
    let setting = Setting::new("rewritten", 2);
    let mut run = setting.up("--loop");
    let (record, _) = setting.start_record("run.mcap", "");
    run.wait_for_lines(1);
    let (shell, mut input) = consumer(&setting);
    rewrite(&shell, &mut input);
    let mut side = shell.side_input(&Topic::OBJECT_POINTS).unwrap();
    rewrite::<u32>(&shell, &mut side);
    drop((input, shell));
    run.wait_for_lines(10);
    record.signal(Signal::TERM);
    record.finish().assert_ended_well();
    let finished = setting.stop(run);
    finished.assert_says(&["stages restarted: 0"]);
    let mut lines = finished.lines.iter();
    assert!(lines.all(|line| line["wire"].is_u64()), "whole lines");
}

#[test]
fn half_made_segments_hang_no_restart() {
    let setting = Setting::new("halfmade", 2);
    let mut run = setting.up("--loop");
    run.wait_for_lines(1);
    let instance = Instance::new(&setting.instance).unwrap();
    let prefix = format!("/dev/shm/{}", instance.prefix());
    let paths = ["1_2.connection", "3.data", "4.dynamic"].map(|name| format!("{prefix}{name}"));
    for stage in ["refiner", "backbone"] {
        for path in &paths {
            fs::write(path, "").unwrap();
        }
        send_signal(run.stage(stage), Signal::KILL);
        run.wait_for_words("segments that a killed process never finished");
        run.wait_for_lines(5);
        assert!(paths.iter().all(|path| fs::metadata(path).is_err()));
    }
    setting.stop(run);
}

/// Runs `mluc up` with its own /dev/shm; `None`, with a message: that needs root.
fn with_shared_memory(setting: &Setting, more: &str, size: &str) -> Option<Running> {
    let tried = "--mount mount -t tmpfs tmpfs /dev/shm".split(' ');
    let tried = Command::new("unshare").args(tried).status();
    if !tried.is_ok_and(|tried| tried.success()) {
        skip("full shared memory", "no right to mount another /dev/shm");
        return None;
    }
    let up = setting.up_command(more);
    let script = format!("mount -t tmpfs -o size={size} tmpfs /dev/shm && exec \"$@\"");
    let mut command = Command::new("unshare");
    command.args(["--mount", "sh", "-c", &script, "sh"]);
    command.arg(up.get_program()).args(up.get_args());
    Some(Running::start(&mut command))
}

#[test]
fn shared_memory_that_is_too_small_is_named_and_one_that_fills_up_later_harms_nobody() {
    let setting = Setting::new("small", 2);
    if let Some(run) = with_shared_memory(&setting, "", "16m") {
        let finished = run.finish();
        finished.assert_ended(1, 0);
        finished.assert_says(&["MiB of shared memory", "--shm-size"]);
    }
    // Once all stages run, another process takes the remaining space.
    if let Some(mut run) = with_shared_memory(&setting, "--loop", "1g") {
        run.wait_for_lines(1);
        let other = format!("/proc/{}/root/dev/shm/other", run.pid());
        let filled = std::io::copy(&mut repeat(0), &mut File::create(other).unwrap());
        assert!(filled.is_err(), "it is full");
        run.wait_for_lines(20);
        run.stop().assert_says(&["stages restarted: 0"]);
    }
    // There is no room for both the old ingest's scans, which the refiner keeps, and the scans of the next ingest.
    if let Some(mut run) = with_shared_memory(&setting, "--loop", "512m") {
        run.wait_for_lines(1);
        send_signal(run.stage("ingest"), Signal::KILL);
        run.wait_for_words("restart in");
        run.wait_for_lines(20);
        run.stop();
    }
}

#[test]
fn another_user_reaches_nothing() {
    if !geteuid().is_root() {
        return skip("another user", "only root can become one");
    }
    let setting = Setting::new("user", 2);
    let mut run = setting.up("--loop");
    run.wait_for_lines(2);
    assert!(leftovers(&setting.instance).len() > 10);
    let script = format!(
        "for f in /dev/shm/mluc-0-{0}*; do cat $f && echo read $f; echo x >> $f && echo wrote $f; rm -rf $f && echo removed $f; done; \
         ls /dev/shm/mluc-0-{0} && echo listed; true",
        setting.instance
    );
    let mut other = Command::new("setpriv");
    other.args("--reuid=65534 --regid=65534 --clear-groups sh -c".split(' '));
    let output = other.arg(&script).output().expect("setpriv starts");
    let told = (output.status.success(), String::from_utf8_lossy(&output.stdout));
    assert_eq!(told, (true, "".into()));
    run.wait_for_lines(5);
    setting.stop(run);
}
