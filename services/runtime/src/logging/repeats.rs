//! Repeated messages, which may differ in their digits: the first ones are written, the others are counted.

use tracing::Level;

/// Time window from the first occurrence of a message, ns.
const WINDOW_NS: u64 = 10_000_000_000;
/// How often a message is written in that time.
const WRITTEN_MAX: u64 = 5;
/// How many different messages are tracked; further messages are always written.
const MESSAGES_MAX: usize = 64;

pub(super) struct Repeated {
    level: Level,
    message: String,
    since_ns: u64,
    count: u64,
}

/// The messages of the current time windows.
pub(super) struct Repeats(pub(super) Vec<Repeated>);

impl Repeats {
    /// Forgets messages whose time window is over. Returns the messages that were not always written, and how often they were left out.
    pub(super) fn ended(&mut self, now_ns: u64) -> Vec<(Level, String, u64)> {
        let is_over = |one: &mut Repeated| now_ns.saturating_sub(one.since_ns) >= WINDOW_NS;
        let ended = self.0.extract_if(.., is_over);
        let counted = ended.map(|r| (r.level, r.message, r.count.saturating_sub(WRITTEN_MAX)));
        counted.filter(|(_, _, count)| *count > 0).collect()
    }

    /// Counts a message. Returns whether it is written.
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

/// A message without its digits.
fn words(message: &str) -> impl Iterator<Item = char> {
    message.chars().filter(|c| !c.is_ascii_digit())
}
