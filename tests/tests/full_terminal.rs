//! Whoever reads may be gone, and a file may be full: an error, never a panic, and nothing left in shared memory.

use std::fs::File;
use std::process::{Command, Stdio};

use mluc_tests::{leftovers, mluc_program};

fn full() -> File {
    File::options()
        .write(true)
        .open("/dev/full")
        .expect("Linux has it")
}

#[test]
fn a_demo_that_cannot_be_printed_ends_with_an_error() {
    let folder = tempfile::tempdir().expect("a folder");
    let picture = folder.path().join("picture.png");
    let mut demo = Command::new(mluc_program());
    demo.arg("demo").arg("--picture").arg(&picture);
    let child = demo
        .stdout(full())
        .stderr(Stdio::piped())
        .spawn()
        .expect("started");
    let instance = format!("demo-{}", child.id());
    let output = child.wait_with_output().expect("ended");
    let log = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{log}");
    assert!(log.contains("standard output"), "{log}");
    assert!(!log.contains("panicked"), "{log}");
    assert!(leftovers(&instance).is_empty());
}

#[test]
fn a_log_that_cannot_be_written_stops_nothing() {
    let folder = tempfile::tempdir().expect("a folder");
    let picture = folder.path().join("picture.png");
    let mut demo = Command::new(mluc_program());
    demo.arg("demo").arg("--picture").arg(&picture);
    let output = demo.stderr(full()).output().expect("started");
    assert_eq!(output.status.code(), Some(0));
    assert!(picture.is_file());
}
