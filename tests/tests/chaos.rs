//! A short run of `tools/chaos`: it kills stages and supervisors, stops stages, and ends runs by two signals. Every loss is counted, nothing is left.

use mluc_tests::{Running, Setting, assert_has, mluc_program, root, skip};
use std::{process::Command, time::Duration};

#[test]
fn chaos_ends_well_and_counts_every_frame() {
    if Command::new("python3").arg("--version").output().is_err() {
        return skip("tools/chaos", "no python3");
    }
    let setting = Setting::new("chaos", 3);
    let mut chaos = Command::new(root().join("tools/chaos"));
    let programs = mluc_program();
    chaos.arg("--programs").arg(programs.with_file_name(""));
    chaos.arg("--input").arg(&setting.input);
    chaos.args("--seconds 6 --seed 4 --starts 3 --signals 6".split(' '));
    let finished = Running::start(&mut chaos).finish_within(Duration::from_secs(180));
    let text = finished.text();
    assert_eq!(finished.code, Some(0), "{text}{}", finished.log);
    let words = [
        "wrong or mixed frames: 0; files left: 0; exit code: 0",
        "3 supervisors killed",
        "6 runs ended by two signals, ",
        "meanwhile: 0 badly",
        "all good",
    ];
    assert_has(&text, &words);
}
