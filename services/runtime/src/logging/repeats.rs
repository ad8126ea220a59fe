//! The same message again and again, whatever its numbers: the first ones are written, the others counted.

use tracing::Level;

/// From the first one on.
const WINDOW_NS: u64 = 10_000_000_000;
/// Of a message in that time.
const WRITTEN_MAX: u64 = 5;
/// Messages that are followed; further ones are written.
const MESSAGES_MAX: usize = 64;

pub(super) struct Repeated {
    level: Level,
    message: String,
    since_ns: u64,
    count: u64,
}

/// The messages of the last time.
pub(super) struct Repeats(pub(super) Vec<Repeated>);

impl Repeats {
    /// Forgets messages whose time is over; gives those that were left out, and how often.
    pub(super) fn ended(&mut self, now_ns: u64) -> Vec<(Level, String, u64)> {
        let is_over =
            |repeated: &mut Repeated| now_ns.saturating_sub(repeated.since_ns) >= WINDOW_NS;
        let ended = self.0.extract_if(.., is_over);
        let counted = ended.map(|r| (r.level, r.message, r.count.saturating_sub(WRITTEN_MAX)));
        counted.filter(|(_, _, count)| *count > 0).collect()
    }

    /// Whether it is written.
    pub(super) fn admit(&mut self, level: Level, message: &str, now_ns: u64) -> bool {
        let alike = |repeated: &&mut Repeated| words(&repeated.message).eq(words(message));
        let found = self.0.iter_mut().find(alike);
        if let Some(repeated) = found {
            repeated.count += 1;
            return repeated.count <= WRITTEN_MAX;
        }
        if self.0.len() < MESSAGES_MAX {
            self.0.push(Repeated {
                level,
                message: message.to_string(),
                since_ns: now_ns,
                count: 1,
            });
        }
        true
    }
}

/// A message without its numbers.
fn words(message: &str) -> impl Iterator<Item = char> {
    message.chars().filter(|c| !c.is_ascii_digit())
}
