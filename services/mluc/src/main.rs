//! The program `mluc`; what it does is in the library of the same name.

use std::sync::atomic::{AtomicBool, Ordering};

/// Rust's runtime replaces a closed stdout with /dev/null before `main`: output would be lost without an error. So this is checked earlier.
static STDOUT_IS_CLOSED: AtomicBool = AtomicBool::new(false);

extern "C" fn look_at_stdout() {
    let is_there = |path: &str| std::fs::symlink_metadata(path).is_ok();
    let is_closed = is_there("/proc/self/fd") && !is_there("/proc/self/fd/1");
    STDOUT_IS_CLOSED.store(is_closed, Ordering::Relaxed);
}

#[allow(unsafe_code)]
// The functions of this section run before `main`; this one makes two system calls and keeps their result.
#[unsafe(link_section = ".init_array")]
#[used]
static BEFORE_MAIN: extern "C" fn() = look_at_stdout;

fn main() -> std::process::ExitCode {
    mluc::main(!STDOUT_IS_CLOSED.load(Ordering::Relaxed))
}
