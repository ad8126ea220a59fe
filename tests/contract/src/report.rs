//! What the suite found.

use minijinja::{Environment, value::Serde};
use serde::Serialize;

#[derive(Serialize)]
pub(crate) struct Verdict {
    /// A word: `overload`.
    pub(crate) name: &'static str,
    /// What the contract asks there.
    pub(crate) asks: &'static str,
    pub(crate) passed: bool,
    /// Passed: what was seen. Failed: why.
    pub(crate) what: String,
    pub(crate) ms: u64,
}

#[derive(Serialize)]
pub(crate) struct Report {
    program: String,
    passed: usize,
    failed: usize,
    /// Not tried, because the program never started.
    not_run: usize,
    cases: Vec<Verdict>,
}

impl Report {
    pub(crate) fn new(program: String, cases: Vec<Verdict>, not_run: usize) -> Report {
        let passed = cases.iter().filter(|case| case.passed).count();
        Report {
            program,
            passed,
            failed: cases.len() - passed,
            not_run,
            cases,
        }
    }

    /// Whether every case passed, and at least one ran.
    pub(crate) fn is_passed(&self) -> bool {
        self.failed == 0 && self.passed > 0
    }

    /// A line a case, and the sum.
    pub(crate) fn text(&self) -> String {
        let text = Environment::new().render_str(include_str!("report.txt"), Serde(self));
        text.expect("a template that fits its values") + "\n"
    }
}
