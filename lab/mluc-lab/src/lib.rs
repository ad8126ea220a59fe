//! What the program `mluc-lab` does itself.
#![warn(clippy::print_stdout, clippy::print_stderr)]

pub mod exchange;
