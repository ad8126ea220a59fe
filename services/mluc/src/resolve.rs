//! Settings from where they are given. A later layer wins: defaults, a running pipeline's document (`mluc stage` alone), the
//! configuration file, the environment, the command line; and the model for the gate's threshold.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::Context;
use mluc_ipc_types::Stage;
use mluc_model::Model;
use mluc_refiner::Variant;
use mluc_runtime::Instance;
use toml::{Table, Value};

use crate::cli::PipelineArgs;
use crate::names::named;
use crate::settings::Settings;
use crate::{UsageError, document, model};

/// The name of the pipeline, where neither file nor command line gives it.
const INSTANCE_VARIABLE: &str = "MLUC_INSTANCE";

/// Where a value comes from.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Origin {
    Default,
    Model,
    Pipeline,
    File(PathBuf),
    Environment(&'static str),
    Flag,
}

impl std::fmt::Display for Origin {
    fn fmt(&self, to: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Origin::Default => to.write_str("default"),
            Origin::Model => to.write_str("model"),
            Origin::Pipeline => to.write_str("running pipeline"),
            Origin::File(path) => write!(to, "file {}", path.display()),
            Origin::Environment(name) => write!(to, "environment {name}"),
            Origin::Flag => to.write_str("flag"),
        }
    }
}

/// Settings, and who set what.
#[derive(Debug)]
pub struct Resolved {
    /// The settings.
    pub settings: Settings,
    origins: BTreeMap<String, Origin>,
}

impl Settings {
    /// Of a command line and what it refers to.
    pub fn resolve(args: PipelineArgs) -> anyhow::Result<Settings> {
        Ok(Resolved::of(args, false)?.settings)
    }
}

impl Resolved {
    /// `joins`: this process is a stage of a pipeline that may be running.
    pub(crate) fn of(args: PipelineArgs, joins: bool) -> anyhow::Result<Resolved> {
        let mut layers = vec![(Origin::Default, Table::try_from(Settings::default())?)];
        if let Some(path) = &args.config {
            layers.push((Origin::File(path.clone()), file_layer(path)?));
        }
        if let Ok(name) = std::env::var(INSTANCE_VARIABLE) {
            let table = Table::from_iter([("instance".to_string(), Value::String(name))]);
            layers.push((Origin::Environment(INSTANCE_VARIABLE), table));
        }
        layers.push((Origin::Flag, flag_layer(&args)?));
        if joins {
            let name = layers
                .iter()
                .rev()
                .find_map(|(_, table)| table.get("instance")?.as_str());
            let instance = Instance::new(name.unwrap_or(Instance::DEFAULT));
            let instance = instance.map_err(|error| UsageError(error.to_string()))?;
            if let Some(table) = document::of_running(&instance) {
                layers.insert(1, (Origin::Pipeline, table));
            }
        }
        let (mut merged, mut origins) = (Table::new(), BTreeMap::new());
        for (origin, layer) in layers {
            merge(&mut merged, layer, "", &origin, &mut origins);
        }
        let usage = |error: toml::de::Error| UsageError(error.message().to_string());
        let mut settings: Settings = merged.try_into().map_err(usage)?;
        settings.complete();
        settings.check()?;
        Ok(Resolved { settings, origins })
    }

    /// Loads the model and takes its threshold where none was given.
    pub(crate) fn load_model(&mut self) -> anyhow::Result<Model> {
        let model = model::load_for(&self.settings)?;
        self.settings.complete_from(&model);
        for key in ["lambda", "unknown_min"] {
            self.origins.entry(key.to_string()).or_insert(Origin::Model);
        }
        Ok(model)
    }

    /// The document with the origin of each value; a configuration file with the same effect.
    pub(crate) fn print(&self) -> anyhow::Result<String> {
        let mut text = String::from("# Settings, resolved, and where each value comes from.\n");
        self.print_table(&Table::try_from(&self.settings)?, "", &mut text);
        Ok(text)
    }

    fn print_table(&self, table: &Table, path: &str, text: &mut String) {
        let below = |key: &str| {
            if path.is_empty() {
                key.to_string()
            } else {
                format!("{path}.{key}")
            }
        };
        for (key, value) in table.iter().filter(|(_, value)| !value.is_table()) {
            let origin = self.origins.get(&below(key)).unwrap_or(&Origin::Default);
            *text += &format!("{:40} # {origin}\n", format!("{key} = {value}"));
        }
        for key in document::known_keys(path) {
            if !table.contains_key(&key) && key != "bench" {
                *text += &format!("{:40} # not set\n", format!("# {key}"));
            }
        }
        for (key, inner) in table
            .iter()
            .filter_map(|(key, value)| Some((key, value.as_table()?)))
        {
            let inner_path = below(key);
            if inner.values().any(|value| !value.is_table()) {
                *text += &format!("\n[{inner_path}]\n");
            }
            self.print_table(inner, &inner_path, text);
        }
    }
}

/// Puts `layer` over `base`, key by key.
fn merge(
    base: &mut Table,
    layer: Table,
    path: &str,
    origin: &Origin,
    origins: &mut BTreeMap<String, Origin>,
) {
    for (key, value) in layer {
        let inner_path = if path.is_empty() {
            key.clone()
        } else {
            format!("{path}.{key}")
        };
        match (base.get_mut(&key), value) {
            (Some(Value::Table(inner)), Value::Table(over)) => {
                merge(inner, over, &inner_path, origin, origins);
            }
            // `track = true` over a table that says how.
            (Some(Value::Table(_)), Value::Boolean(true)) => (),
            (_, Value::Table(over)) => {
                let mut inner = Table::new();
                merge(&mut inner, over, &inner_path, origin, origins);
                base.insert(key, Value::Table(inner));
            }
            (_, value) => {
                origins.insert(inner_path, origin.clone());
                base.insert(key, value);
            }
        }
    }
}

/// A configuration file, checked; without `[bench]`, and with paths that hold in any folder: relative ones are relative to the
/// file.
pub fn file_layer(path: &Path) -> anyhow::Result<Table> {
    // First as settings, for an error that names line and key.
    document::read::<Settings>(path)?;
    let mut table: Table = document::read(path)?;
    table.remove("bench");
    let path =
        std::path::absolute(path).with_context(|| format!("configuration {}", path.display()))?;
    let folder = path.parent().unwrap_or(Path::new("/"));
    let text = |path: PathBuf| Value::String(path.to_string_lossy().into_owned());
    if let Some(input) = table.get("input").and_then(Value::as_str) {
        table.insert("input".to_string(), text(folder.join(input)));
    }
    if let Some(name) = table.get("model").and_then(Value::as_str)
        && !model::is_embedded(name)
        && folder.join(name).exists()
    {
        table.insert("model".to_string(), text(folder.join(name)));
    }
    let stages = table.get_mut("stages").and_then(Value::as_table_mut);
    for (_, stage) in stages.into_iter().flatten() {
        let Some(stage) = stage
            .as_table_mut()
            .filter(|stage| stage.contains_key("command"))
        else {
            continue;
        };
        let directory = stage.get("directory").and_then(Value::as_str).unwrap_or("");
        stage.insert("directory".to_string(), text(folder.join(directory)));
    }
    Ok(table)
}

/// What the command line sets.
fn flag_layer(args: &PipelineArgs) -> anyhow::Result<Table> {
    let mut table = Table::try_from(args)?;
    if let Some(word) = &args.refiner_mode {
        let mode = named("refiner mode", word, &Variant::ALL, Variant::name)?;
        set(
            &mut table,
            &["refiner", "variant"],
            Value::String(mode.name().to_string()),
        );
    }
    for word in &args.threads {
        let (stage, count) = stage_threads(word)?;
        set(
            &mut table,
            &["stages", stage.name(), "threads"],
            Value::Integer(count),
        );
    }
    for name in &args.without {
        let stage = stage_named(name)?;
        set(
            &mut table,
            &["stages", stage.name(), "external"],
            Value::Boolean(true),
        );
    }
    Ok(table)
}

fn set(table: &mut Table, path: &[&str], value: Value) {
    match path {
        [key] => drop(table.insert(key.to_string(), value)),
        [key, rest @ ..] => {
            let inner = table.entry(*key).or_insert(Value::Table(Table::new()));
            if let Value::Table(inner) = inner {
                set(inner, rest, value);
            }
        }
        [] => (),
    }
}

/// A stage by its name, or the nearest one in the error.
pub fn stage_named(name: &str) -> Result<Stage, UsageError> {
    named("stage", name, &Stage::ALL, Stage::name)
}

fn stage_threads(word: &str) -> Result<(Stage, i64), UsageError> {
    let bad = || {
        UsageError(format!(
            "--threads {word}: expected STAGE=N, backbone=2 for instance"
        ))
    };
    let (name, count) = word.split_once('=').ok_or_else(bad)?;
    // A negative count does not fit into a document's usize: refused here, like the other nonsense.
    let count = count.parse::<u16>().map_err(|_| bad())?;
    Ok((stage_named(name)?, i64::from(count)))
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;
    use crate::cli::{Cli, Command};
    use crate::settings::Pace;

    fn args(arguments: &[&str]) -> PipelineArgs {
        let cli = Cli::try_parse_from(["mluc", "up"].iter().chain(arguments)).unwrap();
        let Command::Up(args) = cli.command else {
            panic!("not up")
        };
        args
    }

    fn resolved(arguments: &[&str]) -> anyhow::Result<Resolved> {
        Resolved::of(args(arguments), false)
    }

    const FILE: &str = r#"
        instance = "front"
        input = "scans"
        model = "udi"
        pace = "complete"
        rate_hz = 10.0
        loop = true
        seconds = 3
        unknown_min = 0.6
        track = true
        [stages.backbone]
        threads = 4
        [stages.refiner]
        command = ["python3", "refiner.py"]
        [refiner]
        points_min = 9
        [bench]
        seconds = 2
    "#;

    #[test]
    fn the_command_line_wins_over_the_file_and_the_file_over_defaults() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("mluc.toml");
        std::fs::write(&file, FILE).unwrap();
        let config = format!("--config={}", file.display());
        let found = resolved(&[&config, "--model", "kitti-open", "--threads", "head=3"]).unwrap();
        let settings = &found.settings;
        assert_eq!(
            (settings.pace, settings.repeat, settings.seconds),
            (Pace::Complete, true, Some(3.0))
        );
        assert_eq!(settings.instance.name(), "front");
        assert_eq!(settings.model, "kitti-open");
        assert_eq!(
            [2, 1].map(|stage| settings.stages[Stage::ALL[stage]].threads),
            [3, 4]
        );
        assert_eq!(settings.stages.ingest.threads, 1);
        assert_eq!(
            settings.input.as_deref(),
            Some(&*folder.path().join("scans"))
        );
        let refiner = &settings.stages.refiner;
        assert_eq!(refiner.directory.as_deref(), Some(&*folder.path().join("")));
        assert_eq!(
            (settings.refiner.points_min, settings.track),
            (9, Some(Default::default()))
        );
        assert_eq!(settings.budget_ms, None, "pace complete has no budget");
        for (key, origin) in [
            ("model", Origin::Flag),
            ("stages.head.threads", Origin::Flag),
            ("stages.backbone.threads", Origin::File(file.clone())),
            ("precision", Origin::Default),
        ] {
            assert_eq!(found.origins[key], origin, "{key}");
        }
    }

    #[test]
    fn what_is_printed_resolves_to_the_same() {
        let mut first = resolved(&[
            "--input=a/b",
            "--model=udi",
            "--pace=complete",
            "--rate=5",
            "--loop",
            "--seconds=9",
            "--instance=x",
            "--lambda=1.25",
            "--verify-mapping",
            "--track",
            "--threads=ingest=3",
            "--without=refiner",
            "--budget-ms=70",
            "--precision=bf16",
        ])
        .unwrap();
        first.load_model().unwrap();
        let text = first.print().unwrap();
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("printed.toml");
        std::fs::write(&file, &text).unwrap();
        let again = resolved(&[&format!("--config={}", file.display())]).unwrap();
        assert_eq!(again.settings, first.settings, "{text}");
        assert!(
            text.contains("lambda = 1.25") && text.contains("# flag"),
            "{text}"
        );
        assert!(
            text.contains("# seconds") || text.contains("seconds = 9"),
            "{text}"
        );
        let mut plain = resolved(&[]).unwrap();
        plain.load_model().unwrap();
        let text = plain.print().unwrap();
        let line = text
            .lines()
            .find(|line| line.starts_with("unknown_min = "))
            .unwrap();
        assert!(line.ends_with("# model"), "{line}");
        let unset = text
            .lines()
            .find(|line| line.starts_with("# seconds"))
            .unwrap();
        assert!(unset.ends_with("# not set"), "{unset}");
    }

    #[test]
    fn what_makes_no_sense_is_a_usage_error() {
        for argument in [
            "--rate=0",
            "--rate=NaN",
            "--seconds=-1",
            "--lambda=-0.5",
            "--unknown-min=1.5",
            "--threads=backbone",
            "--threads=bakbone=2",
            "--threads=head=0",
            "--threads=head=-1",
            "--instance=a/b",
            "--refiner-mode=paper-corected",
            "--without=refner",
            "--precision=f64",
            "--config=/nowhere.toml",
        ] {
            let error = resolved(&[argument]).unwrap_err();
            assert!(
                error.downcast_ref::<UsageError>().is_some(),
                "{argument}: {error}"
            );
        }
        let error = resolved(&["--precision=fp32"]).unwrap_err().to_string();
        assert!(error.contains("did you mean 'f32'?"), "{error}");
    }

    #[test]
    fn nonsense_in_the_file_is_refused_before_any_stage_starts() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("mluc.toml");
        for text in [
            "[refiner]\npoints_min = -1",
            "[refiner]\njoin_m = -4.0",
            "[track]\nwindow = 0",
            "modle = 1",
        ] {
            std::fs::write(&file, text).unwrap();
            let error = resolved(&[&format!("--config={}", file.display())]).unwrap_err();
            assert!(
                error.downcast_ref::<UsageError>().is_some(),
                "{text}: {error}"
            );
        }
    }
}
