//! Settings as text: the configuration file with its errors, and the document that a running pipeline hands to its stages.

use crate::{UsageError, settings::Settings};
use anyhow::Context;
use mluc_runtime::Instance;
use serde::de::DeserializeOwned;
use std::path::{Path, PathBuf};
use std::{fs::File, fs::TryLockError, io::Write};
use toml::Table;

/// Reads a TOML file as `T`. An error names line and column, and the nearest key where the key is unknown.
pub fn read<T: DeserializeOwned>(path: &Path) -> anyhow::Result<T> {
    let usage = |cause: String| UsageError(format!("configuration {}: {cause}", path.display()));
    let text = std::fs::read_to_string(path).map_err(|error| usage(error.to_string()))?;
    Ok(parse(&text).map_err(usage)?)
}

fn parse<T: DeserializeOwned>(text: &str) -> Result<T, String> {
    toml::from_str(text).map_err(|error| with_hint(error.to_string().trim_end(), &error))
}

/// The `text` of an error, with a hint if the unknown name is similar to a known one.
pub(crate) fn with_hint(text: &str, error: &toml::de::Error) -> String {
    let words = unknown_and_known(error.message());
    let near = words.split_first().and_then(|(unknown, known)| nearest(unknown, known.to_vec()));
    let hint = near.map(|near| format!("\ndid you mean `{near}`?"));
    format!("{text}{}", hint.unwrap_or_default())
}

/// The candidate with the fewest edits (insert, delete, change a character), if they are few for the word's length.
pub(crate) fn nearest<'a>(word: &str, candidates: Vec<&'a str>) -> Option<&'a str> {
    let distances = candidates.into_iter().map(|name| (strsim::levenshtein(word, name), name));
    let limit = word.chars().count().max(3) / 2 + 1;
    distances.filter(|(distance, _)| *distance <= limit).min().map(|(_, name)| name)
}

/// The words in serde's ``unknown field `modle`, expected one of `instance`, `input`, ...`` (or `variant`): the unknown one, then the known ones.
fn unknown_and_known(message: &str) -> Vec<&str> {
    let is_unknown =
        message.starts_with("unknown field ") || message.starts_with("unknown variant ");
    message.split('`').skip(1).step_by(2).filter(|_| is_unknown).collect()
}

/// All keys of a table of the configuration (`stages.head`; empty: the top), also keys without a default. Empty if there is no such table.
pub fn known_keys(table: &str) -> Vec<String> {
    let key = format!("{table}.\"?\"");
    let texts = [format!("{} = 0", key.trim_start_matches('.')), format!("[[{table}]]\n\"?\" = 0")];
    let errors = texts.map(|text| toml::from_str::<Settings>(&text).err());
    let mut errors = errors.iter().flatten().map(toml::de::Error::message);
    let error = errors.find(|error| error.starts_with("unknown field"));
    unknown_and_known(error.unwrap_or_default()).into_iter().skip(1).map(str::to_string).collect()
}

/// Where the document of a running pipeline lies: in the instance's folder.
fn place(instance: &Instance) -> PathBuf {
    instance.root().join("settings.toml")
}

/// Hands `settings` to the stages of its instance. The caller must have joined the instance, which removes the file when the
/// last process leaves. The document is valid while the returned file is open, because the file is locked until then.
pub(crate) fn publish(settings: &Settings) -> anyhow::Result<File> {
    let path = place(&settings.instance);
    let text = toml::to_string(settings).context("writing the settings")?;
    let write = || -> std::io::Result<File> {
        // A stage never sees a part of a document: it appears under its name only when it is complete and locked.
        let new = path.with_extension("new");
        let mut file = File::create(&new)?;
        file.write_all(text.as_bytes())?;
        file.lock()?;
        std::fs::rename(&new, &path)?;
        Ok(file)
    };
    write().with_context(|| format!("writing {}", path.display()))
}

/// The document of the pipeline that runs under this name; `None` if no supervisor is alive.
pub(crate) fn of_running(instance: &Instance) -> Option<Table> {
    let path = place(instance);
    let file = File::open(&path).ok()?;
    match file.try_lock_shared() {
        Err(TryLockError::WouldBlock) => std::fs::read_to_string(&path).ok()?.parse().ok(),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_that_is_far_from_all_has_no_hint() {
        assert_eq!(nearest("xylophone", vec!["sensor", "complete"]), None);
    }

    #[test]
    fn a_document_counts_while_its_pipeline_is_alive() {
        let instance = Instance::new(&format!("document-{}", std::process::id())).unwrap();
        std::fs::create_dir(instance.root()).unwrap();
        let settings =
            Settings { instance: instance.clone(), seconds: Some(2.5), ..Settings::default() };
        let published = publish(&settings).unwrap();
        let found: Settings = of_running(&instance).unwrap().try_into().unwrap();
        assert_eq!(found, settings);
        drop(published);
        assert!(of_running(&instance).is_none());
        std::fs::remove_dir_all(instance.root()).unwrap();
    }
}
