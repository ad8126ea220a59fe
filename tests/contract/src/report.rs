//! What the suite found.

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
        let mut text = format!("{}\n", self.program);
        for case in &self.cases {
            let word = if case.passed { "pass" } else { "FAIL" };
            let seconds = case.ms as f64 / 1000.0;
            text += &format!(
                "  {word}  {:16} {seconds:6.1} s  {}\n",
                case.name, case.what
            );
            if !case.passed {
                text += &format!("        the contract asks: {}\n", case.asks);
            }
        }
        text += &format!("  {} passed, {} failed", self.passed, self.failed);
        if self.not_run > 0 {
            text += &format!(", {} not run: it never started", self.not_run);
        }
        text + "\n"
    }
}
