//! Checks that need what is not everywhere: real scans, answers from outside, another language's packages.

use std::io::{Write, stderr};
use std::path::PathBuf;

/// Says in one line that a check did not run. `.ci/run` counts these lines.
pub fn skip(what: &str, why: &str) {
    // Cargo captures what the print macros write, not what is written to the stream itself. One call, so that no other
    // test's line comes between.
    let _ = stderr().write_all(format!("skipped: {what}: {why}\n").as_bytes());
}

/// The folder that `variable` names; `None`, said: it is not set. A folder that is missing is a failure, and so is a
/// variable that is not set where `MLUC_REQUIRE_ORACLE=1`.
pub fn data_folder(variable: &str) -> Option<PathBuf> {
    let Some(folder) = std::env::var_os(variable).map(PathBuf::from) else {
        let is_required = std::env::var_os("MLUC_REQUIRE_ORACLE").is_some_and(|value| value == "1");
        let why = format!("{variable} is not set");
        assert!(!is_required, "{why}, and MLUC_REQUIRE_ORACLE=1 asks for it");
        skip(std::thread::current().name().unwrap_or("a test"), &why);
        return None;
    };
    let found = folder.display();
    let is_there = folder.is_dir();
    assert!(is_there, "{variable}: expected a folder, found {found}");
    Some(folder)
}

/// The folder of answers from outside; see [`data_folder`].
pub fn oracle() -> Option<PathBuf> {
    data_folder("MLUC_ORACLE")
}
