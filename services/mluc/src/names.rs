//! One of a few names, or an error with the nearest one.

use crate::UsageError;

/// The candidate with the fewest edits (insert, delete, change a character), if they are few for the word's length.
pub fn nearest<'a>(word: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let limit = word.chars().count().max(3) / 2 + 1;
    candidates
        .into_iter()
        .map(|candidate| (strsim::levenshtein(word, candidate), candidate))
        .filter(|&(distance, _)| distance <= limit)
        .min()
        .map(|(_, candidate)| candidate)
}

/// `; did you mean 'NAME'?`, or nothing where no candidate is near.
pub fn hint<'a>(word: &str, candidates: impl IntoIterator<Item = &'a str>) -> String {
    nearest(word, candidates).map_or(String::new(), |near| format!("; did you mean '{near}'?"))
}

/// The value of this name; `what` names the kind in the error.
pub fn named<T: Copy>(
    what: &str,
    word: &str,
    all: &[T],
    name: impl Fn(T) -> &'static str,
) -> Result<T, UsageError> {
    let found = all.iter().copied().find(|value| name(*value) == word);
    found.ok_or_else(|| {
        let names: Vec<&str> = all.iter().map(|value| name(*value)).collect();
        let hint = hint(word, names.iter().copied());
        UsageError(format!(
            "no {what} '{word}': there are {}{hint}",
            names.join(", ")
        ))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_is_found_and_the_far_is_not() {
        let known = ["instance", "input", "model", "pace"];
        assert_eq!(nearest("modle", known), Some("model"));
        assert_eq!(nearest("inpt", known), Some("input"));
        assert_eq!(nearest("xylophone", known), None);
        let error = named("key", "pcae", &known, |name| name).unwrap_err();
        assert!(
            error.to_string().contains("did you mean 'pace'?"),
            "{error}"
        );
    }
}
