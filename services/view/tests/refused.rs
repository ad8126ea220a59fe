//! A start that is not possible is refused with a clear message, and leaves everything unchanged.

use std::{net::TcpListener, process::Command};

#[test]
fn a_port_that_is_taken_and_a_file_that_exists_are_refused() {
    let taken = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = taken.local_addr().expect("its address");
    let port = address.port().to_string();
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/Cargo.toml");
    let before = std::fs::read(file).expect("a file");
    let instance = format!("view-refused-{}", std::process::id());
    for (words, expected) in [
        (["view", "--port", &port], address.to_string()),
        (["record", "--out", file], file.to_string()),
    ] {
        let mut program = Command::new(env!("CARGO_BIN_EXE_mluc-view"));
        let ended = program.args(words).args(["--instance", &instance]).output();
        let ended = ended.expect("it starts");
        let log = String::from_utf8_lossy(&ended.stderr);
        assert_eq!(ended.status.code(), Some(1), "{log}");
        assert!(log.contains(&expected), "{log}");
    }
    assert_eq!(std::fs::read(file).expect("a file"), before);
}
