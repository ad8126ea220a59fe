//! What is to be measured, resolved and checked before any process is started.

use super::arguments::{BenchTable, RunArgs};
use crate::report::FRAMES_MIN;
use anyhow::{Context, Result};
use mluc::{UsageError, document, model, settings::DEFAULT_MODEL};
use mluc::{bundled::BundledScans, external::installed_program, resolve::file_layer};
use mluc_backbone::Precision;
use mluc_kernels::Level;
use mluc_model::Model;
use mluc_refiner::Variant as RefinerVariant;
use mluc_sources::{Source, files::Layout};
use serde::Deserialize;
use serde_json::{Value, json};
use std::{fmt::Display, ops::RangeInclusive, path::Path, path::PathBuf, time::Duration};
use tempfile::TempDir;
use toml::Table;

const SECONDS: f64 = 20.0;
/// An assumed limit: a million frames at 10 Hz.
const SECONDS_MAX: f64 = 100_000.0;
const WARM_UP_SECONDS: f64 = 2.0;
const RATE_HZ: f64 = 10.0;
const RATE_HZ_MAX: f64 = 1000.0;
/// Starts of each side when two are compared.
const ROUNDS_COMPARED: u32 = 4;
const ROUNDS_MAX: u32 = 1000;
const PATIENCE_SECONDS: f64 = 60.0;

pub(crate) struct Plan {
    /// The program `mluc`.
    pub(crate) program: PathBuf,
    /// The refiner's name, or the command in its place.
    pub(crate) refiner: String,
    /// Arguments of `mluc up` that select the refiner.
    refiner_arguments: Vec<String>,
    pub(crate) args: RunArgs,
    pub(crate) input: PathBuf,
    pub(crate) model_name: String,
    precision: String,
    pub(crate) rate_hz: f64,
    pub(crate) seconds: f64,
    pub(crate) warm_up_seconds: f64,
    pub(crate) rounds: u32,
    pub(crate) patience: Duration,
    pub(crate) model: Model,
    stages: Value,
    /// Description of the scans for the page's head.
    scans: String,
    // Deleted from the disk when the plan is dropped.
    _configuration: TempDir,
    _bundled: Option<BundledScans>,
}

impl Plan {
    pub(crate) fn resolve(mut args: RunArgs) -> Result<Plan> {
        let (document, table) = read_scenario(args.scenario.as_deref())?;
        let table = args.bench.over(table);
        let word = |key: &str| document.get(key)?.as_str().map(str::to_string);
        args.profile = args.profile.or(word("profile"));
        if word("pace").as_deref() == Some("complete") {
            return usage(
                "a measurement is open loop: pace = \"complete\" waits for the pipeline and hides its stalls; take it out of the scenario",
            );
        }
        let program = mluc_program()?;
        if let Some(other) = args.against.as_ref().filter(|other| find(other).is_none()) {
            return usage(format!("--against: no program {}", other.display()));
        }
        let folder = tempfile::tempdir().context("making a folder for the configuration")?;
        let (input, origin, bundled) = match args.input.clone().or(word("input").map(PathBuf::from))
        {
            Some(given) => {
                let origin = format!("of {}", given.display());
                (given, origin, None)
            }
            None => {
                let bundled = BundledScans::write("bench")?;
                let origin = "bundled simulated scans".to_string();
                (bundled.folder().to_path_buf(), origin, Some(bundled))
            }
        };
        let layout = document.get("layout").cloned().map(Layout::deserialize);
        let layout = layout.transpose()?.unwrap_or_default();
        let count = Source::open(&input, &layout, false)?.count();
        let count = count.map_or("all".to_string(), |count| count.to_string());
        let scans = format!("{count} {origin}, in turn");
        let model_name = args.model.clone().or(word("model"));
        let model_name = model_name.unwrap_or_else(|| DEFAULT_MODEL.to_string());
        let file = folder.path().join("configuration.toml");
        let (refiner, refiner_arguments) = refiner(&args, &document, &file)?;
        let usual = if args.compares() { ROUNDS_COMPARED } else { 1 };
        let rounds = within("rounds", table.rounds.unwrap_or(usual), 1..=ROUNDS_MAX)?;
        let rate_hz = document.get("rate_hz").cloned().map(f64::deserialize);
        let rate_hz = args.rate.or(rate_hz.transpose()?).unwrap_or(RATE_HZ);
        if !(rate_hz > 0.0 && rate_hz <= RATE_HZ_MAX) {
            return usage(format!(
                "rate must be above 0 and at most {RATE_HZ_MAX}, found {rate_hz}"
            ));
        }
        let warm_up = table.warm_up_seconds.unwrap_or(WARM_UP_SECONDS);
        let patience = table.patience_seconds.unwrap_or(PATIENCE_SECONDS);
        let patience = within("patience", patience, 0.1..=SECONDS_MAX)?;
        let seconds = table.seconds.unwrap_or(SECONDS);
        if args.compares() && seconds * rate_hz < FRAMES_MIN as f64 {
            let frames = seconds * rate_hz;
            return usage(format!(
                "seconds x rate must be {FRAMES_MIN} frames or more to compare, found {frames}"
            ));
        }
        let model = model::load(&model_name)?;
        let precision = args.precision.clone().or(word("precision"));
        let named = |level: &Level| Some(level.name()) == word("instruction_set").as_deref();
        if let Some(level) = Level::all().into_iter().find(named) {
            level.restrict();
        }
        let chosen = || Precision::Auto.chosen(&model.manifest, &model.weights).0;
        let precision = precision.filter(|name| name != Precision::Auto.name());
        let precision = precision.unwrap_or_else(|| format!("{} (auto)", chosen()));
        Ok(Plan {
            rate_hz,
            seconds: within("seconds", seconds, 0.1..=SECONDS_MAX)?,
            warm_up_seconds: within("warm-up", warm_up, 0.0..=SECONDS_MAX)?,
            rounds,
            patience: Duration::from_secs_f64(patience),
            model,
            stages: json!(document.get("stages").unwrap_or(&Table::new().into())),
            program,
            refiner,
            refiner_arguments,
            input,
            model_name,
            precision,
            args,
            scans,
            _configuration: folder,
            _bundled: bundled,
        })
    }

    pub(crate) fn round_seconds(&self) -> f64 {
        self.seconds / f64::from(self.rounds)
    }

    /// Options that both `mluc up` and another `mluc bench` receive.
    pub(crate) fn shared_arguments(&self) -> Vec<String> {
        let (input, rate_hz) = (self.input.display().to_string(), self.rate_hz.to_string());
        let optional = [
            ("--precision", &self.args.precision),
            ("--sensor", &self.args.sensor),
            ("--profile", &self.args.profile),
            ("--min-score", &self.args.min_score),
            ("--min-unknown-score", &self.args.min_unknown_score),
        ];
        let optional = optional.into_iter();
        let optional = optional.flat_map(|(key, word)| word.iter().map(move |word| (key, word)));
        let threads = self.args.threads.iter().map(|word| ("--threads", word));
        let keys = ["--input", "--model", "--rate"].into_iter();
        let options = keys.zip([&input, &self.model_name, &rate_hz]).chain(optional).chain(threads);
        options.flat_map(|(key, value)| [key.to_string(), value.clone()]).collect()
    }

    pub(crate) fn up_arguments(&self, instance: &str) -> Vec<String> {
        let seconds = (self.warm_up_seconds + self.round_seconds()).to_string();
        let words = ["up", "--loop", "--pace", "sensor", "--instance", instance];
        let words = words.into_iter().chain(["--seconds", &seconds]);
        let words = words.map(str::to_string).chain(self.shared_arguments());
        let refiner = self.refiner_arguments.iter().cloned();
        words.chain(refiner).collect()
    }

    pub(crate) fn title(&self) -> String {
        let (model, precision) = (&self.model_name, &self.precision);
        let (rate_hz, scans) = (self.rate_hz, &self.scans);
        format!("mluc bench: {model}, {precision}, {rate_hz} Hz, {scans}")
    }

    pub(crate) fn describe(&self) -> Value {
        let words = std::env::args_os().map(|word| word.to_string_lossy().into_owned());
        json!({
            "scans": self.scans,
            "rate_hz": self.rate_hz,
            "seconds": self.seconds,
            "warm_up_seconds": self.warm_up_seconds,
            "rounds": self.rounds,
            "model": self.model_name,
            "model_fingerprint": format!("{:016x}", self.model.fingerprint),
            "network": self.model.manifest.network.profile.to_string(),
            "precision": self.precision,
            "profile": self.args.profile.as_deref().unwrap_or("balanced"),
            "refiner": self.refiner,
            "threads": self.args.threads,
            "stages": self.stages,
            "command": words.collect::<Vec<_>>().join(" "),
        })
    }
}

fn usage<T>(text: impl Into<String>) -> Result<T> {
    Err(UsageError(text.into()).into())
}

fn within<T: PartialOrd + Display>(name: &str, value: T, range: RangeInclusive<T>) -> Result<T> {
    if range.contains(&value) {
        return Ok(value);
    }
    let (least, most) = range.into_inner();
    usage(format!("{name} must be {least} to {most}, found {value}"))
}

/// The scenario's file without `[bench]`, and that table. Without a path, both are empty.
fn read_scenario(path: Option<&Path>) -> Result<(Table, BenchTable)> {
    #[derive(Deserialize)]
    struct Scenario {
        #[serde(default)]
        bench: BenchTable,
    }
    let Some(path) = path else {
        return Ok(Default::default());
    };
    let scenario = document::read::<Scenario>(path)?;
    Ok((file_layer(path)?, scenario.bench))
}

/// The program `mluc`: next to this program, else on the path.
pub(crate) fn mluc_program() -> Result<PathBuf> {
    let program = installed_program("mluc");
    find(&program).with_context(|| {
        let own = std::env::current_exe().unwrap_or_default();
        format!(
            "the program mluc is missing: it is neither {} nor on the path; build it with `cargo build --release -p mluc`",
            own.with_file_name("mluc").display()
        )
    })
}

/// The file of a program: a name with a slash is used as it is, any other is searched on the path.
fn find(program: &Path) -> Option<PathBuf> {
    if program.components().count() > 1 {
        return program.is_file().then(|| program.to_path_buf());
    }
    let path = std::env::var_os("PATH").unwrap_or_default();
    std::env::split_paths(&path).map(|folder| folder.join(program)).find(|file| file.is_file())
}

/// The refiner of the options (the first of two), else of the scenario, and the arguments of `mluc up` that select it. `file`: for a configuration.
fn refiner(args: &RunArgs, document: &Table, file: &Path) -> Result<(String, Vec<String>)> {
    if args.refiner.len() > 2 || (args.against.is_some() && args.refiner.len() > 1) {
        return usage("--refiner can be given once, or twice without --against");
    }
    for word in args.refiner.iter().rev() {
        check_refiner(word)?;
    }
    if let Some(word) = args.refiner.first() {
        return Ok((word.clone(), with_refiner(document.clone(), word, file)?));
    }
    let stages = document.get("stages");
    let own = stages.and_then(|stages| stages.get("refiner")?.get("command")?.as_array());
    let settings = document.get("refiner");
    let named = settings.and_then(|settings| settings.get("variant")?.as_str());
    let named = named.unwrap_or(RefinerVariant::default().name());
    let words = own.map(|words| words.iter().filter_map(toml::Value::as_str));
    let name = words.map_or(named.to_string(), |words| words.collect::<Vec<_>>().join(" "));
    let scenario = args.scenario.iter();
    let config = scenario.flat_map(|path| ["--config".to_string(), path.display().to_string()]);
    Ok((name, config.collect()))
}

/// Checks a refiner: one of our names, or a command whose program exists.
fn check_refiner(word: &str) -> Result<()> {
    let program = word.split_whitespace().next().map(Path::new);
    if RefinerVariant::from_name(word).is_some() || program.and_then(find).is_some() {
        return Ok(());
    }
    let names = RefinerVariant::ALL.map(RefinerVariant::name).join(", ");
    usage(format!("no refiner '{word}': there are {names}, or a program's command"))
}

/// Writes the scenario's configuration with one of our refiners, or with a command, to `file`; returns the arguments of `mluc up` for it.
fn with_refiner(mut document: Table, word: &str, file: &Path) -> Result<Vec<String>> {
    let mut at = &mut document;
    for key in ["stages", "refiner"] {
        let inner = at.entry(key).or_insert_with(|| Table::new().into());
        let wrong = || UsageError(format!("scenario: {key} must be a table"));
        at = inner.as_table_mut().ok_or_else(wrong)?;
    }
    let mut arguments = vec!["--config".to_string(), file.display().to_string()];
    if RefinerVariant::from_name(word).is_some() {
        at.remove("command");
        at.remove("directory");
        arguments.extend(["--refiner-variant".to_string(), word.to_string()]);
    } else {
        let directory = std::env::current_dir().context("finding the current folder")?;
        let directory = directory.to_string_lossy().into_owned();
        let command: Vec<&str> = word.split_whitespace().collect();
        at.insert("command".to_string(), command.into());
        at.insert("directory".to_string(), directory.into());
    }
    std::fs::write(file, toml::to_string(&document)?)
        .with_context(|| format!("writing {}", file.display()))?;
    Ok(arguments)
}
