//! A short chaos: stages and supervisors are killed, stages are stopped, two signals end runs; nothing is lost uncounted or left.

use std::time::Duration;

use mluc_tests::{Running, assert_has};

#[test]
fn chaos_ends_well_and_counts_every_frame() {
    let words = "bench chaos --seconds 6 --seed 4 --starts 3 --signals 6";
    let finished = Running::mluc(words.split(' ')).finish_within(Duration::from_secs(180));
    let text = finished.text();
    assert_eq!(finished.code, Some(0), "{text}{}", finished.log);
    let words = [
        "wrong or mixed frames: 0; files left: 0; exit code: Some(0)",
        "3 supervisors killed",
        "6 runs ended by two signals, ",
        "meanwhile: 0 badly",
        "all good",
    ];
    assert_has(&text, &words);
}
