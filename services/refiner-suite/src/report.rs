//! What the suite found.

use serde::Serialize;

/// One case.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Verdict {
    /// A word: `overload`.
    pub name: &'static str,
    /// What the contract asks there.
    pub asks: &'static str,
    /// Whether the program did it.
    pub passed: bool,
    /// Passed: what was seen. Failed: why.
    pub what: String,
    /// How long the case took, ms.
    pub ms: u64,
}

/// All cases of one program.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// Which program.
    pub program: String,
    /// How many cases it passed.
    pub passed: usize,
    /// How many it failed.
    pub failed: usize,
    /// Each of them, in the order they ran.
    pub cases: Vec<Verdict>,
}

impl Report {
    pub(crate) fn new(program: String) -> Report {
        Report {
            program,
            passed: 0,
            failed: 0,
            cases: Vec::new(),
        }
    }

    pub(crate) fn add(&mut self, verdict: Verdict) {
        match verdict.passed {
            true => self.passed += 1,
            false => self.failed += 1,
        }
        self.cases.push(verdict);
    }

    /// Whether every case passed, and at least one ran.
    pub fn is_passed(&self) -> bool {
        self.failed == 0 && self.passed > 0
    }

    /// A line a case, and the sum.
    pub fn text(&self) -> String {
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
        text + &format!("  {} passed, {} failed\n", self.passed, self.failed)
    }
}
