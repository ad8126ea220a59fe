//! Merges the settings from their sources. A later layer wins: defaults, a running pipeline's document (only for `mluc stage`),
//! the configuration file, the environment, the command line. The model gives the gate's threshold if none was given.

use crate::{UsageError, document, model};
use crate::{cli::PipelineArgs, document::with_hint, settings::Settings};
use anyhow::Context;
use mluc_model::{Model, SensorProfile};
use mluc_runtime::Instance;
use mluc_sources::{FOLLOW, is_live};
use std::{collections::BTreeMap, path::Path};
use toml::{Table, Value};

/// Settings, and the origin of each value.
#[derive(Debug)]
pub(crate) struct Resolved {
    pub(crate) settings: Settings,
    /// The origin of the value of each key that was set, for instance `stages.head.threads`.
    origins: BTreeMap<String, String>,
}

impl Settings {
    pub(crate) fn resolve(args: PipelineArgs) -> anyhow::Result<Settings> {
        Ok(Resolved::of(args, false)?.settings)
    }
}

impl Resolved {
    /// `joins`: this process is a stage of a pipeline that may be running.
    pub(crate) fn of(args: PipelineArgs, joins: bool) -> anyhow::Result<Resolved> {
        let mut layers = vec![("default".to_string(), Table::try_from(Settings::default())?)];
        if let Some(path) = &args.config {
            layers.push((format!("file {}", path.display()), file_layer(path)?));
        }
        let variable = Instance::VARIABLE;
        if let Some(name) = std::env::var(variable).ok().filter(|name| !name.is_empty()) {
            let table = Table::from_iter([("instance".to_string(), Value::String(name))]);
            layers.push((format!("environment {variable}"), table));
        }
        let flags = flag_layers(&args)?.into_iter();
        layers.extend(flags.map(|table| ("flag".to_string(), table)));
        if joins {
            let name = layers.iter().rev().find_map(|(_, table)| table.get("instance")?.as_str());
            let instance = Instance::new(name.unwrap_or(Instance::DEFAULT));
            let instance = instance.map_err(|error| UsageError(error.to_string()))?;
            if let Some(table) = document::of_running(&instance) {
                layers.insert(1, ("running pipeline".to_string(), table));
            }
        }
        let (mut merged, mut origins) = (Table::new(), BTreeMap::new());
        for (origin, layer) in layers {
            merge(&mut merged, layer, "", &mut |key| {
                origins.insert(key, origin.clone());
            });
        }
        let usage = |error: toml::de::Error| UsageError(with_hint(error.message(), &error));
        let mut settings: Settings = merged.try_into().map_err(usage)?;
        settings.complete();
        settings.check()?;
        if !joins {
            settings.sensor.load()?;
        }
        Ok(Resolved { settings, origins })
    }

    /// Loads the model and takes its threshold where none was given.
    pub(crate) fn load_model(&mut self) -> anyhow::Result<Model> {
        let model = model::load_for(&self.settings)?;
        self.settings.complete_from(&model);
        for key in ["lambda", "unknown_min"] {
            self.origins.entry(key.to_string()).or_insert("model".to_string());
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
        for (key, value) in table.iter().filter(|(_, value)| !value.is_table()) {
            let origin = self.origins.get(&below(path, key)).map_or("default", String::as_str);
            // Defaults stay defaults, and the model's own threshold must not be used with another model: both are commented out.
            let mark = if ["default", "model"].contains(&origin) { "# " } else { "" };
            *text += &format!("{:40} # {origin}\n", format!("{mark}{key} = {value}"));
        }
        for key in document::known_keys(path) {
            if !table.contains_key(&key) && key != "bench" {
                *text += &format!("{:40} # not set\n", format!("# {key}"));
            }
        }
        for (key, value) in table {
            let Value::Table(inner) = value else { continue };
            let inner_path = below(path, key);
            if inner.values().any(|value| !value.is_table()) {
                *text += &format!("\n[{inner_path}]\n");
            }
            self.print_table(inner, &inner_path, text);
        }
    }
}

/// The path of a key in a table, such as `stages.head`; the path of the top is empty.
pub(crate) fn below(path: &str, key: &str) -> String {
    format!("{path}.{key}").trim_start_matches('.').to_string()
}

/// Puts `layer` over `base`, key by key; `tell` gets the path of each key that is set.
fn merge(base: &mut Table, layer: Table, path: &str, tell: &mut dyn FnMut(String)) {
    for (key, value) in layer {
        let inner_path = below(path, &key);
        match (base.get_mut(&key), value) {
            // `track = true` keeps the table of an earlier layer.
            (Some(Value::Table(_)), Value::Boolean(true)) => (),
            (Some(Value::Table(own)), Value::Table(over)) => merge(own, over, &inner_path, tell),
            (_, Value::Table(over)) => {
                let mut inner = Table::new();
                merge(&mut inner, over, &inner_path, tell);
                base.insert(key, Value::Table(inner));
            }
            (_, value) => {
                tell(inner_path);
                base.insert(key, value);
            }
        }
    }
}

/// A configuration file, checked, without `[bench]`. Its paths are made absolute: relative ones are relative to the file.
pub fn file_layer(path: &Path) -> anyhow::Result<Table> {
    // It is first read as settings, so that an error names line and key.
    document::read::<Settings>(path)?;
    let mut table: Table = document::read(path)?;
    table.remove("bench");
    let absolute = std::path::absolute(path);
    let path = absolute.with_context(|| format!("configuration {}", path.display()))?;
    rebase(&mut table, path.parent().unwrap_or(Path::new("/")));
    Ok(table)
}

/// Makes the paths of a layer absolute: relative ones are relative to `folder`. Names of built-in models and sensors, and addresses, stay.
fn rebase(layer: &mut Table, folder: &Path) {
    let absolute = |name: &str| {
        let path = name.strip_prefix(FOLLOW);
        let scheme = path.map_or("", |_| FOLLOW);
        let path = folder.join(path.unwrap_or(name));
        let path = std::path::absolute(&path).unwrap_or(path);
        Value::String(format!("{scheme}{}", path.to_string_lossy()))
    };
    let is_path = |key: &str, name: &str| match key {
        "input" if name.is_empty() || name == FOLLOW => false,
        "input" => name.starts_with(FOLLOW) || !is_live(Path::new(name)),
        "model" => model::built_in(name).is_none() && folder.join(name).exists(),
        "profile" => SensorProfile::names().all(|product| product != name),
        _ => true,
    };
    for (table, key) in [
        ("", "input"),
        ("", "model"),
        ("sensor", "profile"),
        ("layout", "calibration"),
        ("lidar", "input"),
        ("lidar", "calibration"),
    ] {
        let values = match layer.get_mut(table) {
            None => vec![layer.get_mut(key).filter(|_| table.is_empty())],
            Some(Value::Array(inner)) => inner.iter_mut().map(|one| one.get_mut(key)).collect(),
            Some(inner) => vec![inner.get_mut(key)],
        };
        for value in values.into_iter().flatten() {
            if let Some(name) = value.as_str().filter(|name| is_path(key, name)) {
                *value = absolute(name);
            }
        }
    }
    let stages = layer.get_mut("stages").and_then(Value::as_table_mut);
    for (_, stage) in stages.into_iter().flatten() {
        if let Value::Table(stage) = stage
            && stage.contains_key("command")
        {
            let directory = stage.get("directory").and_then(Value::as_str).unwrap_or("");
            stage.insert("directory".to_string(), absolute(directory));
        }
    }
}

fn flag_layers(args: &PipelineArgs) -> anyhow::Result<Vec<Table>> {
    let mut lines = vec![];
    for (stage, count) in &args.threads {
        lines.push(format!("stages.{}.threads = {count}", stage.name()));
    }
    for stage in &args.without {
        lines.push(format!("stages.{stage}.external = true"));
    }
    if let Some(name) = &args.refiner_variant {
        lines.push(format!("refiner.variant = '{name}'"));
    }
    if let Some(profile) = &args.sensor {
        let profile = Value::from(profile.as_str());
        lines.push(format!("sensor.profile = {profile}"));
    }
    let mut layers = vec![Table::try_from(args)?];
    for line in lines {
        layers.push(line.parse()?);
    }
    // A folder that is gone matters only to relative paths.
    let folder = std::env::current_dir().unwrap_or_default();
    layers.iter_mut().for_each(|layer| rebase(layer, &folder));
    Ok(layers)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{cli::Cli, cli::Command, settings::Pace};
    use clap::Parser;

    fn resolved(arguments: &[&str]) -> Resolved {
        let cli = Cli::try_parse_from(["mluc", "up"].iter().chain(arguments)).unwrap();
        let Command::Up(args) = cli.command else { panic!("not up") };
        Resolved::of(args, false).unwrap()
    }

    /// A configuration file in a folder of its own, and the option that names it.
    fn config(text: &str) -> (tempfile::TempDir, String) {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("mluc.toml");
        std::fs::write(&file, text).unwrap();
        (folder, format!("--config={}", file.display()))
    }

    const FILE: &str = include_str!("resolve_file.toml");

    #[test]
    fn the_command_line_wins_over_the_file_and_the_file_over_defaults() {
        let (folder, file) = config(FILE);
        let Resolved { settings, origins } =
            resolved(&[&file, "--model", "my.safetensors", "--threads", "head=3"]);
        let mut expected = Settings {
            instance: Instance::new("front").unwrap(),
            input: Some(folder.path().join("scans")),
            model: "my.safetensors".into(),
            pace: Pace::Complete,
            rate_hz: Some(10.0),
            repeat: true,
            seconds: Some(3.0),
            unknown_min: Some(0.6),
            track: Some(Default::default()),
            // Pace `complete` has no budget.
            budget_ms: None,
            ..Settings::default()
        };
        expected.stages.backbone.threads = 4;
        expected.stages.head.threads = 3;
        expected.stages.refiner.command = Some(vec!["python3".into(), "refiner.py".into()]);
        expected.stages.refiner.directory = Some(folder.path().join(""));
        expected.refiner.points_min = 9;
        expected.robot.height_min_m = 0.2;
        expected.refiner.robot = expected.robot;
        assert_eq!(settings, expected);
        let path = folder.path().join("mluc.toml");
        let from_file = format!("file {}", path.display());
        for (key, origin) in [
            ("model", "flag"),
            ("stages.head.threads", "flag"),
            ("stages.backbone.threads", &from_file),
            ("loop", &from_file),
            ("precision", "default"),
        ] {
            assert_eq!(origins[key], origin, "{key}");
        }
    }

    #[test]
    fn what_is_printed_resolves_to_the_same() {
        let words = "--input=a/b --model=../../weights/paper/udi.safetensors --pace=complete --rate=5 --loop --seconds=9 --instance=x --lambda=1.25 \
            --verify-mapping --track --threads=ingest=3 --without=refiner --budget-ms=70 --precision=bf16 \
            --refiner-variant=paper --profile=quiet --min-unknown-score=0.25";
        let mut first = resolved(&words.split_whitespace().collect::<Vec<_>>());
        first.load_model().unwrap();
        let text = first.print().unwrap();
        let (_folder, file) = config(&text);
        let mut again = resolved(&[&file]);
        again.load_model().unwrap();
        assert_eq!(again.settings, first.settings, "{text}");
        assert_eq!(again.settings.refiner.score_min.unknown, 0.25);

        let mut plain = resolved(&[]);
        let balanced = plain.load_model().unwrap().manifest.thresholds.profiles.unwrap().balanced;
        assert_eq!(plain.settings.refiner.score_min, balanced);
        let plain = plain.print().unwrap();
        for (text, key, origin) in [
            (&text, "lambda = 1.25", "# flag"),
            (&text, "seconds = 9", "# flag"),
            (&text, "min_unknown_score = 0.25", "# flag"),
            (&plain, "# profile = \"balanced\"", "# default"),
            (&plain, "# unknown_min = ", "# model"),
            (&plain, "# seconds", "# not set"),
        ] {
            let line = text.lines().find(|line| line.starts_with(key));
            let line = line.unwrap_or_else(|| panic!("{key}: {text}"));
            assert!(line.ends_with(origin), "{key}: {text}");
        }
    }
}
