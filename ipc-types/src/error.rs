//! What a consumer answers to a message that breaks the contract.

/// A message that breaks the contract; each variant names what was expected and what was found.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ContractError {
    /// The other side was built with another contract.
    #[error(
        "wire version {found} of the sender, expected {expected}: run the same mluc on both sides"
    )]
    WireVersion {
        /// Ours.
        expected: u32,
        /// The sender's.
        found: u32,
    },
    /// A length beyond its bound.
    #[error("{what}: {found} exceeds the limit of {limit}")]
    TooLong {
        /// Which length.
        what: &'static str,
        /// The bound.
        limit: usize,
        /// The length read.
        found: usize,
    },
    /// Two lengths that must agree.
    #[error("{what}: expected {expected}, found {found}")]
    Mismatch {
        /// Which quantity.
        what: &'static str,
        /// By the header or the model.
        expected: u64,
        /// In the message.
        found: u64,
    },
    /// An index outside of what it points into.
    #[error("{what}: index {found} outside of {len} entries")]
    Index {
        /// Which index.
        what: &'static str,
        /// Entries there.
        len: usize,
        /// The index read.
        found: usize,
    },
    /// A number that is none of an enum's values.
    #[error("{what}: {found} is no known value")]
    Value {
        /// Which enum.
        what: &'static str,
        /// The number read.
        found: u32,
    },
    /// A message of another run of the pipeline.
    #[error("run {found:016x} of the sender, this run is {expected:016x}")]
    OtherRun {
        /// [`crate::RunDescription::run_id`] of this run.
        expected: u64,
        /// The sender's.
        found: u64,
    },
    /// A frame that goes back, or that ingest has not sent.
    #[error(
        "sequence {found}: expected at least {first} and less than {end}, the frames that ingest has sent"
    )]
    Sequence {
        /// The last one seen.
        first: u64,
        /// Frames that ingest has sent.
        end: u64,
        /// The sender's.
        found: u64,
    },
    /// Numbers that contradict each other or the contract.
    #[error("{what}: entry {index} breaks the contract")]
    Inconsistent {
        /// Which rule.
        what: &'static str,
        /// Where.
        index: usize,
    },
    /// A number that is not finite.
    #[error("{what}: entry {index} is not finite")]
    NotFinite {
        /// Which quantity.
        what: &'static str,
        /// Where.
        index: usize,
    },
}
