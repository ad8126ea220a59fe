//! `mluc-lab` as a person runs it, in its own folder: the result is files, JSON or a table, or a clear error.

mod adapt;
mod evaluate;
mod exchange;
mod exchange_torch;
mod reproduce;
mod train;

use mluc_tests::write_file;
use serde_json::Value;
use std::{path::PathBuf, process::Command, process::Output};

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Folder {
        Folder(tempfile::tempdir().expect("a folder"))
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn read(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
    }

    fn write(&self, name: &str, content: impl AsRef<[u8]>) {
        write_file(&self.path(name), content);
    }

    /// Changes a file while `what` runs.
    fn with(&self, name: &str, change: impl Fn(&[u8]) -> Vec<u8>, what: impl Fn()) {
        let before = self.read(name);
        self.write(name, change(&before));
        what();
        self.write(name, before);
    }

    /// `mluc-lab` with words as on a command line, in this folder.
    fn command(&self, words: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_mluc-lab"));
        command.args(words.split_whitespace());
        command.current_dir(self.0.path());
        command
    }

    /// Runs a command that must succeed.
    #[track_caller]
    fn run(&self, words: &str) -> Output {
        let output = self.command(words).output().expect("started");
        assert!(output.status.success(), "{}", text(&output.stderr));
        output
    }

    /// Runs a command that must print JSON.
    #[track_caller]
    fn json(&self, words: &str) -> Value {
        serde_json::from_slice(&self.run(words).stdout).expect("JSON on stdout")
    }

    /// Runs a command that must fail without an answer; its last message must have all these words.
    #[track_caller]
    fn refuses(&self, words: &str, said: &[&str]) {
        let output = self.command(words).output().expect("started");
        let log = text(&output.stderr);
        assert!(matches!(output.status.code(), Some(1 | 2)), "{log}");
        assert!(output.stdout.is_empty() && !log.contains("panicked"), "{log}");
        let last = ["mluc-lab: ", "error: "].iter().find_map(|start| log.rfind(start));
        let fault = &log[last.expect("a message")..];
        assert!(said.iter().all(|word| fault.contains(word)), "{said:?}: {log}");
    }
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}
