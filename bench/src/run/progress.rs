//! A line on stderr that shows how far the measurement is; only on a terminal.

use indicatif::{ProgressBar, ProgressStyle};

/// Steps of the whole bar.
const STEPS: u64 = 1000;

pub(crate) struct Progress(ProgressBar);

impl Progress {
    pub(crate) fn new() -> Progress {
        let bar = ProgressBar::new(STEPS);
        let style = ProgressStyle::with_template("[{bar:30}] {msg}");
        Progress(bar.with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar())))
    }

    /// `share`: 0 to 1.
    pub(crate) fn show(&mut self, share: f64, what: &str) {
        self.0
            .set_position((share.clamp(0.0, 1.0) * STEPS as f64) as u64);
        self.0.set_message(what.to_string());
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}
