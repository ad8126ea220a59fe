//! Which network each row stands on.

/// Key of a row and the kind of its network.
pub(super) const METHOD_NETWORKS: [(&str, &str); 11] = [
    ("closed-set", "sigmoid"),
    ("supervised", "supervised"),
    ("naive", "softmax"),
    ("osis", "osis"),
    ("osis-geo", "softmax"),
    ("ml-only", "metric"),
    ("uc-only", "softmax"),
    ("mluc-literal", "metric"),
    ("mluc-corrected", "metric"),
    ("mluc-open", "metric-open"),
    ("improved", "improved"),
];

/// Rows that are judged on further seeds too, where those are asked for.
const SEEDED_ROWS: [&str; 4] = ["naive", "mluc-literal", "mluc-corrected", "improved"];

/// Rows on a kind of network of some seed.
pub(super) fn rows_on(network: &str, seed: u64) -> impl Iterator<Item = &'static str> {
    METHOD_NETWORKS
        .iter()
        .filter(move |(method, on)| *on == network && (seed == 1 || SEEDED_ROWS.contains(method)))
        .map(|(method, _)| *method)
}

/// The kind of network of a row.
pub(super) fn network_of(method: &str) -> &'static str {
    METHOD_NETWORKS
        .iter()
        .find(|(key, _)| *key == method)
        .map_or("", |(_, network)| network)
}

/// Key of an evaluation of one step of the improved method.
pub(super) fn step_key(step: usize) -> String {
    format!("improved-step{step}")
}
