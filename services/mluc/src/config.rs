//! The configuration file. Unknown keys are refused, with the nearest known one.

use std::path::{Path, PathBuf};

use anyhow::Context;
use mluc_refiner::{Settings as RefinerSettings, TrackSettings};
use serde::Deserialize;

use crate::UsageError;
use crate::cli::Pace;
use crate::commands::BenchTable;
use crate::nearest::nearest;

/// The whole file; everything may be left out.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Config {
    pub(crate) instance: Option<String>,
    pub(crate) input: Option<PathBuf>,
    pub(crate) model: Option<String>,
    pub(crate) pace: Option<Pace>,
    pub(crate) rate_hz: Option<f64>,
    pub(crate) lambda: Option<f32>,
    pub(crate) unknown_min: Option<f32>,
    pub(crate) budget_ms: Option<u64>,
    pub(crate) precision: Option<String>,
    #[serde(default)]
    pub(crate) stages: StageTables,
    /// `[bench]`: how `mluc bench` measures this configuration.
    pub(crate) bench: Option<BenchTable>,
    /// `[refiner]`: the algorithm's own settings.
    pub(crate) refiner: Option<RefinerSettings>,
    /// `[track]`: temporal voting, which this table switches on.
    pub(crate) track: Option<TrackSettings>,
}

/// `[stages.NAME]`.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct StageTables {
    pub(crate) ingest: StageTable,
    pub(crate) backbone: StageTable,
    pub(crate) head: StageTable,
    pub(crate) refiner: StageTable,
}

/// How one stage runs.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct StageTable {
    /// Another program in the stage's place: program and arguments.
    pub(crate) command: Option<Vec<String>>,
    /// Left to the user, who starts and replaces it by hand (`--without`).
    pub(crate) external: bool,
    /// Threads that compute.
    pub(crate) threads: Option<usize>,
    /// Cores that it may run on, counted from 0; all when not given.
    pub(crate) cpus: Option<Vec<usize>>,
    /// Real-time priority (SCHED_FIFO), 1 to 99: runs before everything that has none.
    pub(crate) priority: Option<u8>,
}

impl Config {
    pub(crate) fn read(path: &Path) -> anyhow::Result<Config> {
        let text = std::fs::read_to_string(path)
            .with_context(|| format!("reading configuration {}", path.display()))?;
        Config::parse(&text).map_err(|cause| {
            UsageError(format!("configuration {}: {cause}", path.display())).into()
        })
    }

    fn parse(text: &str) -> Result<Config, String> {
        toml::from_str(text).map_err(|error| {
            let hint = suggestion(error.message())
                .map_or(String::new(), |key| format!("\ndid you mean `{key}`?"));
            format!("{}{hint}", error.to_string().trim_end())
        })
    }
}

/// From serde's ``unknown field `modle`, expected one of `instance`, `input`, ...`` the nearest of the expected ones.
fn suggestion(message: &str) -> Option<&str> {
    let mut quoted = message
        .strip_prefix("unknown field ")?
        .split('`')
        .skip(1)
        .step_by(2);
    let found = quoted.next()?;
    nearest(found, quoted)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_file_is_read() {
        let text = r#"
            instance = "front"
            input = "scans"
            model = "udi"
            pace = "complete"
            rate_hz = 10.0
            lambda = 1.2
            unknown_min = 0.6
            [stages.backbone]
            threads = 4
            [stages.refiner]
            command = ["python3", "refiner.py"]
            [refiner]
            mode = "literal"
        "#;
        let config = Config::parse(text).unwrap();
        assert_eq!(config.pace, Some(Pace::Complete));
        assert_eq!(config.stages.backbone.threads, Some(4));
        assert_eq!(config.stages.refiner.command.unwrap().len(), 2);
        assert_eq!(config.refiner.unwrap().mode.name(), "literal");
    }

    #[test]
    fn an_unknown_key_is_refused_with_the_nearest() {
        for (text, found, hint) in [
            ("modle = 1", "modle", "model"),
            ("[stages.backbon]\nthreads = 1", "backbon", "backbone"),
            ("[stages.head]\nthread = 1", "thread", "threads"),
            ("[refiner]\nmod = 1", "mod", "mode"),
        ] {
            let error = Config::parse(text).unwrap_err();
            assert!(error.contains(&format!("`{found}`")), "{error}");
            assert!(
                error.contains(&format!("did you mean `{hint}`?")),
                "{error}"
            );
        }
    }

    #[test]
    fn a_wrong_value_names_its_line() {
        let error = Config::parse("model = \"udi\"\npace = \"fast\"").unwrap_err();
        assert!(
            error.contains("line 2") && error.contains("sensor"),
            "{error}"
        );
    }
}
