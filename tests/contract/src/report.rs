//! The suite's results.

use minijinja::{Environment, value::Serde};
use serde::Serialize;

#[derive(Serialize)]
pub(crate) struct Verdict {
    /// One word, for example `overload`.
    pub(crate) name: &'static str,
    /// What the contract requires in this case.
    pub(crate) asks: &'static str,
    pub(crate) passed: bool,
    /// If passed: what was seen. If failed: the reason.
    pub(crate) what: String,
    pub(crate) ms: u64,
}

#[derive(Serialize)]
pub(crate) struct Report {
    program: String,
    passed: usize,
    failed: usize,
    /// Cases that were not tried because the program never started.
    not_run: usize,
    cases: Vec<Verdict>,
}

impl Report {
    pub(crate) fn new(program: String, cases: Vec<Verdict>, not_run: usize) -> Report {
        let passed = cases.iter().filter(|case| case.passed).count();
        Report { program, passed, failed: cases.len() - passed, not_run, cases }
    }

    /// Whether every case passed, and at least one ran.
    pub(crate) fn is_passed(&self) -> bool {
        self.failed == 0 && self.passed > 0
    }

    /// One line per case, and the totals.
    pub(crate) fn text(&self) -> String {
        let text = Environment::new().render_str(include_str!("report.txt"), Serde(self));
        text.expect("a template that fits its values") + "\n"
    }
}
