//! `mluc-bench`; `mluc bench` starts it.

fn main() -> std::process::ExitCode {
    mluc_bench::program()
}
