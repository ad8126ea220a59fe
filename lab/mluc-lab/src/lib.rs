//! Implementation of the program `mluc-lab`.
#![warn(clippy::print_stdout, clippy::print_stderr)]

pub mod exchange;
