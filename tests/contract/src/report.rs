//! What the suite found.

use serde::Serialize;

/// One case.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Verdict {
    /// A word: `overload`.
    pub(crate) name: &'static str,
    /// What the contract asks there.
    pub(crate) asks: &'static str,
    /// Whether the program did it.
    pub(crate) passed: bool,
    /// Passed: what was seen. Failed: why.
    pub(crate) what: String,
    /// How long the case took, ms.
    pub(crate) ms: u64,
}

/// All cases of one program.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Report {
    /// Which program.
    pub(crate) program: String,
    /// How many cases it passed.
    pub(crate) passed: usize,
    /// How many it failed.
    pub(crate) failed: usize,
    /// How many were not tried, because the program never started.
    pub(crate) not_run: usize,
    /// Each of them, in the order they ran.
    pub(crate) cases: Vec<Verdict>,
}

impl Report {
    pub(crate) fn new(program: String) -> Report {
        Report {
            program,
            passed: 0,
            failed: 0,
            not_run: 0,
            cases: Vec::new(),
        }
    }

    pub(crate) fn add(&mut self, verdict: Verdict) {
        if verdict.passed {
            self.passed += 1;
        } else {
            self.failed += 1;
        }
        self.cases.push(verdict);
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
            text += &format!(
                "  {word}  {:16} {:6.1} s  {}\n",
                case.name,
                case.ms as f64 / 1000.0,
                case.what
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
