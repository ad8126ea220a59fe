//! The errors about messages that break the contract.

pub(crate) type Result<T> = std::result::Result<T, ContractError>;

/// A message that breaks the contract; each variant names what was expected and what was found.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs)] // The message above each variant says what its fields are.
pub enum ContractError {
    /// The other side was built with another contract.
    #[error(
        "wire version {found} of the sender, expected {expected}: run the same mluc on both sides"
    )]
    WireVersion { expected: u32, found: u32 },
    /// A length beyond its bound: what, the bound, the length.
    #[error("{0}: {2} exceeds the limit of {1}")]
    TooLong(&'static str, usize, usize),
    /// Two quantities that must agree: what, expected, found.
    #[error("{0}: expected {1}, found {2}")]
    Mismatch(&'static str, u64, u64),
    /// An index outside of what it points into: what, the number of entries, the index.
    #[error("{0}: index {2} outside of {1} entries")]
    Index(&'static str, usize, usize),
    /// A number that is not a value of an enum.
    #[error("{what}: {found} is no known value")]
    Value { what: &'static str, found: u32 },
    /// A message of another run of the pipeline.
    #[error("run {found:016x} of the sender, this run is {expected:016x}")]
    OtherRun { expected: u64, found: u64 },
    /// A frame whose sequence goes backwards (`first` is the last one seen), or that ingest has not sent.
    #[error(
        "sequence {found}: expected at least {first} and less than {end}, the frames that ingest has sent"
    )]
    Sequence { first: u64, end: u64, found: u64 },
    /// Numbers that contradict each other or the contract.
    #[error("{what}: entry {index} breaks the contract")]
    Inconsistent { what: &'static str, index: usize },
    /// A number that is not finite, or outside of what it may be.
    #[error("{what}: entry {index} has a number that is not finite or out of its range")]
    NotFinite { what: &'static str, index: usize },
}

/// Refuses the first field whose numbers are not sound, of the entry at `index`.
pub(crate) fn check_numbers<const N: usize>(
    index: usize,
    fields: [(&'static str, bool); N],
) -> Result<()> {
    let wrong = fields.into_iter().find(|(_, is_sound)| !is_sound);
    wrong.map_or(Ok(()), |(what, _)| Err(ContractError::NotFinite { what, index }))
}

pub(crate) fn require(holds: bool, error: ContractError) -> Result<()> {
    if holds { Ok(()) } else { Err(error) }
}

pub(crate) fn check_version(found: u32) -> Result<()> {
    let expected = crate::WIRE_VERSION;
    let error = ContractError::WireVersion { expected, found };
    require(found == expected, error)
}

pub(crate) fn check_length(what: &'static str, found: usize, limit: usize) -> Result<()> {
    require(found <= limit, ContractError::TooLong(what, limit, found))
}

pub(crate) fn check_index(what: &'static str, found: usize, len: usize) -> Result<()> {
    require(found < len, ContractError::Index(what, len, found))
}

/// Refuses a number that is not one of an enum's `values`, which begin at 0.
pub(crate) fn check_value(what: &'static str, found: u32, values: usize) -> Result<()> {
    let is_known = (found as usize) < values;
    require(is_known, ContractError::Value { what, found })
}

pub(crate) fn check_equal(what: &'static str, found: u64, expected: u64) -> Result<()> {
    let error = ContractError::Mismatch(what, expected, found);
    require(found == expected, error)
}
