//! Which network each row stands on.

/// Key of a row and the kind of its network.
pub(super) const METHOD_NETWORKS: [(&str, &str); 10] = [
    ("closed-set", "sigmoid"),
    ("supervised", "supervised"),
    ("naive", "softmax"),
    ("osis", "osis"),
    ("osis-geo", "softmax"),
    ("ml-only", "metric"),
    ("uc-only", "softmax"),
    ("mluc-literal", "metric"),
    ("mluc-corrected", "metric"),
    ("improved", "improved"),
];

/// Rows on a kind of network.
pub(super) fn rows_on(network: &str) -> impl Iterator<Item = &'static str> {
    METHOD_NETWORKS
        .iter()
        .filter(move |(_, on)| *on == network)
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
