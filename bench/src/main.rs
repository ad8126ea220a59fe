//! The program `mluc-bench`: measurements of mluc. `mluc bench` starts it.

mod machine;
mod report;
mod run;

fn main() -> std::process::ExitCode {
    run::program()
}
