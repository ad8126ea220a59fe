//! A line on stderr that says how far the measurement is; only on a terminal.

use std::io::{IsTerminal, Write};

const CELLS: usize = 30;

pub(super) struct Progress {
    is_shown: bool,
    said: String,
}

impl Progress {
    pub(super) fn new() -> Progress {
        Progress {
            is_shown: std::io::stderr().is_terminal(),
            said: String::new(),
        }
    }

    /// `share`: 0 to 1.
    pub(super) fn show(&mut self, share: f64, what: &str) {
        let text = line(share, what);
        if !self.is_shown || text == self.said {
            return;
        }
        // Lost where it cannot be written.
        let mut out = std::io::stderr();
        let _ = write!(out, "\r{text}\x1b[K").and_then(|()| out.flush());
        self.said = text;
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        if self.is_shown && !self.said.is_empty() {
            let _ = write!(std::io::stderr(), "\r\x1b[K");
        }
    }
}

fn line(share: f64, what: &str) -> String {
    let full = (share.clamp(0.0, 1.0) * CELLS as f64) as usize;
    format!("[{}{}] {what}", "#".repeat(full), ".".repeat(CELLS - full))
}

#[cfg(test)]
mod tests {
    use super::line;

    #[test]
    fn the_bar_never_leaves_its_brackets() {
        for share in [-1.0, 0.0, 0.5, 1.0, 7.0, f64::NAN] {
            assert_eq!(line(share, "x").find(']'), Some(31), "{share}");
        }
    }
}
