//! Settings as text: the configuration file with its errors, and the document that a running pipeline hands to its stages.

use std::fs::{File, TryLockError};
use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::Context;
use mluc_runtime::Instance;
use serde::de::DeserializeOwned;
use toml::Table;

use crate::UsageError;
use crate::names::nearest;
use crate::settings::Settings;

/// Reads a TOML file as `T`. An error names line and column, and the nearest key where the key is unknown.
pub fn read<T: DeserializeOwned>(path: &Path) -> anyhow::Result<T> {
    let usage = |cause: String| UsageError(format!("configuration {}: {cause}", path.display()));
    let text = std::fs::read_to_string(path).map_err(|error| usage(error.to_string()))?;
    Ok(parse(&text).map_err(usage)?)
}

pub(crate) fn parse<T: DeserializeOwned>(text: &str) -> Result<T, String> {
    toml::from_str(text).map_err(|error| {
        let mut expected = expected_keys(error.message());
        let hint = (!expected.is_empty())
            .then(|| expected.remove(0))
            .and_then(|found| nearest(found, expected))
            .map_or(String::new(), |key| format!("\ndid you mean `{key}`?"));
        format!("{}{hint}", error.to_string().trim_end())
    })
}

/// The words in serde's ``unknown field `modle`, expected one of `instance`, `input`, ...``: the unknown key, then the known
/// ones.
fn expected_keys(message: &str) -> Vec<&str> {
    let words = message.strip_prefix("unknown field ");
    words.map_or(Vec::new(), |words| {
        words.split('`').skip(1).step_by(2).collect()
    })
}

/// All keys of a table of the configuration (`stages.head`; empty: the top), those without a default too. Empty where
/// there is no such table.
pub fn known_keys(table: &str) -> Vec<String> {
    let header = if table.is_empty() {
        String::new()
    } else {
        format!("[{table}]\n")
    };
    let Err(error) = toml::from_str::<Settings>(&format!("{header}\"?\" = 0")) else {
        return Vec::new();
    };
    let keys = expected_keys(error.message());
    keys.into_iter().skip(1).map(str::to_string).collect()
}

/// The document of a running pipeline, in the instance's folder. It counts while this value holds its lock.
#[derive(Debug)]
pub struct Published {
    _lock: File,
}

fn place(instance: &Instance) -> PathBuf {
    instance.root().join("settings.toml")
}

/// Hands `settings` to the stages of its instance. The caller must have joined the instance, which removes the file when the
/// last process leaves.
pub fn publish(settings: &Settings) -> anyhow::Result<Published> {
    let path = place(&settings.instance);
    let text = toml::to_string(settings).context("writing the settings")?;
    let write = || -> std::io::Result<File> {
        // A stage never sees half a document: it appears under its name when it is whole and locked.
        let new = path.with_extension("new");
        let mut file = File::create(&new)?;
        file.write_all(text.as_bytes())?;
        file.lock()?;
        std::fs::rename(&new, &path)?;
        Ok(file)
    };
    let lock = write().with_context(|| format!("writing {}", path.display()))?;
    Ok(Published { _lock: lock })
}

/// The document of the pipeline that runs under this name; none where no supervisor is alive.
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
    fn an_unknown_key_is_refused_with_line_and_the_nearest() {
        for (text, found, hint) in [
            ("modle = 1", "modle", "model"),
            ("[stages.backbon]\nthreads = 1", "backbon", "backbone"),
            ("[stages.head]\nthread = 1", "thread", "threads"),
            ("[refiner]\nvarient = 1", "varient", "variant"),
            ("[track]\nwindw = 1", "windw", "window"),
        ] {
            let error = parse::<Settings>(text).unwrap_err();
            assert!(error.contains(&format!("`{found}`")), "{error}");
            assert!(
                error.contains(&format!("did you mean `{hint}`?")),
                "{error}"
            );
        }
        let error = parse::<Settings>("model = \"udi\"\npace = \"fast\"").unwrap_err();
        assert!(
            error.contains("line 2") && error.contains("sensor"),
            "{error}"
        );
    }

    #[test]
    fn keys_without_a_default_are_known_too() {
        let keys = known_keys("");
        assert!(keys.iter().any(|key| key == "seconds") && keys.iter().any(|key| key == "stages"));
        assert!(known_keys("stages.head").iter().any(|key| key == "cpus"));
        assert!(known_keys("track").iter().any(|key| key == "window"));
        assert!(known_keys("model").is_empty());
    }

    #[test]
    fn a_document_counts_while_its_pipeline_is_alive() {
        let instance = Instance::new(&format!("document-{}", std::process::id())).unwrap();
        std::fs::create_dir(instance.root()).unwrap();
        let settings = Settings {
            instance: instance.clone(),
            seconds: Some(2.5),
            ..Settings::default()
        };
        let published = publish(&settings).unwrap();
        let found: Settings = of_running(&instance).unwrap().try_into().unwrap();
        assert_eq!(found, settings);
        drop(published);
        assert!(of_running(&instance).is_none());
        std::fs::remove_dir_all(instance.root()).unwrap();
    }
}
