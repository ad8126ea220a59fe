//! What is to be measured, resolved and checked before any process is started.

use std::fmt::Display;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context, Result};
use mluc::bundled::BundledScans;
use mluc::settings::DEFAULT_MODEL;
use mluc::source::Source;
use mluc::{UsageError, model};
use mluc_model::Model;
use mluc_refiner::Variant as RefinerVariant;
use serde::Deserialize;
use serde_json::{Map, Value, json};
use tempfile::TempDir;
use toml::Table;

use super::arguments::{Instrumentation, RunArgs};
use super::quality::Labels;
use super::scenario::{self, BenchTable, LoadTable};
use super::trace::TraceRequest;
use crate::machine::{available_mib, object};

const SECONDS: f64 = 20.0;
const WARM_UP_SECONDS: f64 = 2.0;
const RATE_HZ: f64 = 10.0;
const RATE_HZ_MAX: f64 = 1000.0;
/// When two variants are compared: each starts so often.
const ROUNDS_COMPARED: u32 = 4;
const ROUNDS_MAX: u32 = 1000;
const BASELINE_ROUNDS: usize = 200;
const PATIENCE_SECONDS: f64 = 60.0;
/// A guess: a million frames at 10 Hz.
const SECONDS_MAX: f64 = 100_000.0;
/// `off`: the stages leave their stamps out.
const STAMPS_VARIABLE: &str = "MLUC_STAMPS";

/// One thing that is measured.
#[derive(Clone)]
pub(crate) struct Variant {
    /// For tables, and, when there are two, of its folder.
    pub(crate) name: String,
    /// What it adds to [`Plan::arguments`].
    arguments: Vec<String>,
    /// Variables that the stages find in their environment.
    pub(crate) environment: Vec<(&'static str, String)>,
    refiner: String,
    commands: Value,
}

impl Variant {
    pub(crate) fn has_stamps(&self) -> bool {
        self.environment
            .iter()
            .all(|(key, _)| *key != STAMPS_VARIABLE)
    }
}

/// A whole measurement.
pub(crate) struct Plan {
    /// The program `mluc`.
    pub(crate) program: PathBuf,
    pub(crate) variants: Vec<Variant>,
    /// The program `mluc` of another build.
    pub(crate) against: Option<PathBuf>,
    pub(crate) args: RunArgs,
    pub(crate) input: PathBuf,
    pub(crate) model_name: String,
    precision: String,
    pub(crate) out: PathBuf,
    pub(crate) rate_hz: f64,
    pub(crate) seconds: f64,
    pub(crate) warm_up_seconds: f64,
    pub(crate) rounds: u32,
    pub(crate) baseline_rounds: usize,
    pub(crate) patience: Duration,
    pub(crate) load: LoadTable,
    pub(crate) instrumentation: Instrumentation,
    pub(crate) trace: Option<TraceRequest>,
    pub(crate) labels: Labels,
    pub(crate) model: Model,
    stages: Value,
    /// For the page's head.
    scans: String,
    // Removed from the disk with the plan.
    _configurations: TempDir,
    _bundled: Option<BundledScans>,
}

impl Plan {
    pub(crate) fn resolve(args: RunArgs) -> Result<Plan> {
        let (document, table) = scenario::read(args.scenario.as_deref())?;
        if document.get("pace").and_then(|pace| pace.as_str()) == Some("complete") {
            return Err(UsageError(
                "a measurement is open loop: pace = \"complete\" waits for the pipeline and hides its stalls; take it out of the scenario".to_string(),
            )
            .into());
        }
        table.load.check(available_mib())?;
        let program = mluc_program()?;
        let folder = tempfile::tempdir().context("making a folder for configurations")?;
        let word = |key: &str| document.get(key)?.as_str().map(str::to_string);
        let given = args.input.clone().or(word("input").map(PathBuf::from));
        let bundled = given.is_none().then(|| BundledScans::write("bench"));
        let bundled = bundled.transpose()?;
        let (input, scans) = match (given, &bundled) {
            (None, Some(bundled)) => {
                let input = bundled.folder().to_path_buf();
                (input, "bundled simulated scans".to_string())
            }
            (given, _) => {
                let input = given.unwrap_or_default();
                let scans = format!("of {}", input.display());
                (input, scans)
            }
        };
        let scans = format!("{} {scans}, in turn", Source::find(&input)?.scans.len());
        let model_name = args.model.clone().or(word("model"));
        let model_name = model_name.unwrap_or_else(|| DEFAULT_MODEL.to_string());
        let numbers = Numbers::resolve(&args, &table)?;
        let instrumentation = args.instrumentation.unwrap_or_default();
        let variants = variants(&args, instrumentation, &document, folder.path())?;
        let is_compared = variants.len() > 1 || args.against.is_some();
        let rounds = numbers
            .rounds
            .unwrap_or(if is_compared { ROUNDS_COMPARED } else { 1 });
        let rate_hz = document.get("rate_hz").cloned().map(f64::deserialize);
        let rate_hz = checked_rate_hz(args.rate.or(rate_hz.transpose()?).unwrap_or(RATE_HZ))?;
        let precision = args.precision.clone().or(word("precision"));
        Ok(Plan {
            trace: TraceRequest::resolve(&args, variants.len())?,
            variants,
            against: args.against.clone(),
            out: args.out.clone().unwrap_or_else(|| "mluc-bench".into()),
            rate_hz,
            seconds: numbers.seconds,
            warm_up_seconds: numbers.warm_up_seconds,
            rounds,
            baseline_rounds: numbers.baseline_rounds,
            patience: Duration::from_secs_f64(numbers.patience_seconds),
            load: table.load,
            instrumentation,
            labels: Labels::near(&input),
            model: model::load(&model_name)?,
            stages: json!(document.get("stages")),
            program,
            input,
            model_name,
            precision: precision.unwrap_or_else(|| "f32".to_string()),
            args,
            scans,
            _configurations: folder,
            _bundled: bundled,
        })
    }

    /// Measured seconds of one round.
    pub(crate) fn round_seconds(&self) -> f64 {
        self.seconds / f64::from(self.rounds)
    }

    /// The command line of `mluc up`.
    pub(crate) fn up_arguments(&self, variant: &Variant, instance: &str) -> Vec<String> {
        let seconds = self.warm_up_seconds + self.round_seconds();
        let mut words = vec!["up".to_string()];
        let mut add =
            |key: &str, value: &dyn Display| words.extend([key.into(), value.to_string()]);
        add("--instance", &instance);
        add("--input", &self.input.display());
        add("--model", &self.model_name);
        add("--pace", &"sensor");
        add("--rate", &self.rate_hz);
        add("--seconds", &seconds);
        if let Some(precision) = &self.args.precision {
            add("--precision", precision);
        }
        for threads in &self.args.threads {
            add("--threads", threads);
        }
        words.push("--loop".to_string());
        words.extend(variant.arguments.iter().cloned());
        words
    }

    pub(crate) fn title(&self) -> String {
        let Plan {
            model_name,
            precision,
            rate_hz,
            scans,
            ..
        } = self;
        format!("mluc bench: {model_name}, {precision}, {rate_hz} Hz, {scans}")
    }

    /// For the report: what ran.
    pub(crate) fn describe(&self, variant: &Variant) -> Map<String, Value> {
        object(json!({
            "scans": self.scans,
            "rate_hz": self.rate_hz,
            "seconds": self.seconds,
            "warm_up_seconds": self.warm_up_seconds,
            "rounds": self.rounds,
            "model": self.model_name,
            "model_fingerprint": format!("{:016x}", self.model.fingerprint),
            "network": self.model.manifest.network.profile.to_string(),
            "precision": self.precision,
            "refiner": variant.refiner,
            "threads": self.args.threads,
            "stages": self.stages,
            "commands": variant.commands,
            "load": self.load,
            "command": std::env::args().collect::<Vec<_>>().join(" "),
        }))
    }
}

/// Beside this program, else on the path.
fn mluc_program() -> Result<PathBuf> {
    let own = std::env::current_exe().context("finding this program's file")?;
    let beside = own.with_file_name("mluc");
    if beside.is_file() {
        return Ok(beside);
    }
    on_path("mluc").with_context(|| {
        format!(
            "the program mluc is missing: it is neither {} nor on the path; build it with `cargo build --release -p mluc`",
            beside.display()
        )
    })
}

fn on_path(name: &str) -> Option<PathBuf> {
    let path = std::env::var_os("PATH").unwrap_or_default();
    let found = std::env::split_paths(&path).map(|folder| folder.join(name));
    found.into_iter().find(|file| file.is_file())
}

fn checked_rate_hz(rate_hz: f64) -> Result<f64, UsageError> {
    if rate_hz > 0.0 && rate_hz <= RATE_HZ_MAX {
        return Ok(rate_hz);
    }
    Err(UsageError(format!(
        "rate must be above 0 and at most {RATE_HZ_MAX}, found {rate_hz}"
    )))
}

/// The numbers of the command line over those of the table over the defaults.
struct Numbers {
    seconds: f64,
    warm_up_seconds: f64,
    rounds: Option<u32>,
    baseline_rounds: usize,
    patience_seconds: f64,
}

impl Numbers {
    fn resolve(args: &RunArgs, table: &BenchTable) -> Result<Numbers, UsageError> {
        let within = |name: &str, given: [Option<f64>; 2], default: f64, least: f64| {
            let value = given[0].or(given[1]).unwrap_or(default);
            if (least..=SECONDS_MAX).contains(&value) {
                return Ok(value);
            }
            Err(UsageError(format!(
                "{name} must be {least} to {SECONDS_MAX}, found {value}"
            )))
        };
        let rounds = args.rounds.or(table.rounds);
        if let Some(rounds) = rounds.filter(|rounds| !(1..=ROUNDS_MAX).contains(rounds)) {
            return Err(UsageError(format!(
                "rounds must be 1 to {ROUNDS_MAX}, found {rounds}"
            )));
        }
        let warm_up = [args.warm_up, table.warm_up_seconds];
        let patience = [args.patience, table.patience_seconds];
        let baseline_rounds = args.floor_rounds.or(table.floor_rounds);
        Ok(Numbers {
            seconds: within("seconds", [args.seconds, table.seconds], SECONDS, 0.1)?,
            warm_up_seconds: within("warm-up", warm_up, WARM_UP_SECONDS, 0.0)?,
            rounds,
            baseline_rounds: baseline_rounds.unwrap_or(BASELINE_ROUNDS).min(1_000_000),
            patience_seconds: within("patience", patience, PATIENCE_SECONDS, 0.1)?,
        })
    }
}

/// One, or the two that are compared. `folder`: for configuration files.
fn variants(
    args: &RunArgs,
    instrumentation: Instrumentation,
    document: &Table,
    folder: &Path,
) -> Result<Vec<Variant>> {
    let mut variants = Vec::new();
    for (number, word) in args.refiner.iter().enumerate() {
        let file = folder.join(format!("configuration-{number}.toml"));
        variants.push(with_refiner(document.clone(), word, &file)?);
    }
    if variants.is_empty() {
        variants.push(of_scenario(args, document));
    }
    if variants.len() > 2 {
        let found = variants.len();
        let text = format!("--refiner can be given once or twice, found {found} times");
        return Err(UsageError(text).into());
    }
    let off = (STAMPS_VARIABLE, "off".to_string());
    match instrumentation {
        Instrumentation::On => Ok(variants),
        Instrumentation::Off => {
            for variant in &mut variants {
                variant.environment.push(off.clone());
            }
            Ok(variants)
        }
        Instrumentation::Compare if variants.len() > 1 => Err(UsageError(
            "--instrumentation compare and two --refiner cannot be told apart: one after the other, please".to_string(),
        )
        .into()),
        Instrumentation::Compare => {
            let mut bare = variants[0].clone();
            variants[0].name = "instrumented".to_string();
            bare.name = "bare".to_string();
            bare.environment.push(off);
            variants.push(bare);
            Ok(variants)
        }
    }
}

/// The refiner that the scenario names, else the usual one.
fn of_scenario(args: &RunArgs, document: &Table) -> Variant {
    let of = |table: &str, key: &str| document.get(table)?.get(key).cloned();
    let refiner = of("refiner", "variant").and_then(|name| Some(name.as_str()?.to_string()));
    let refiner = refiner.unwrap_or_else(|| RefinerVariant::default().name().to_string());
    let scenario = args.scenario.as_ref();
    let config = scenario.map(|path| ["--config".to_string(), path.display().to_string()]);
    Variant {
        name: refiner.clone(),
        arguments: config.into_iter().flatten().collect(),
        environment: Vec::new(),
        refiner,
        commands: json!(of("stages", "refiner").and_then(|stage| stage.get("command").cloned())),
    }
}

/// A name of ours, or a program with arguments, in the scenario's configuration.
fn with_refiner(mut document: Table, word: &str, file: &Path) -> Result<Variant> {
    let command: Vec<String> = word.split_whitespace().map(str::to_string).collect();
    let is_ours = RefinerVariant::from_name(word).is_some();
    if !is_ours && !command.first().is_some_and(|program| is_program(program)) {
        let names = RefinerVariant::ALL.map(RefinerVariant::name).join(", ");
        let text = format!("no refiner '{word}': there are {names}, or a program's command");
        return Err(UsageError(text).into());
    }
    let mut at = &mut document;
    for key in ["stages", "refiner"] {
        let inner = at.entry(key).or_insert_with(|| Table::new().into());
        at = inner
            .as_table_mut()
            .ok_or_else(|| UsageError(format!("scenario: {key} must be a table")))?;
    }
    let mut arguments = vec!["--config".to_string(), file.display().to_string()];
    if is_ours {
        at.remove("command");
        at.remove("directory");
        arguments.extend(["--refiner-mode".to_string(), word.to_string()]);
    } else {
        at.insert("command".to_string(), command.clone().into());
        let directory = std::env::current_dir().context("finding the current folder")?;
        at.insert(
            "directory".to_string(),
            directory.to_string_lossy().into_owned().into(),
        );
    }
    std::fs::write(file, toml::to_string(&document)?)
        .with_context(|| format!("writing {}", file.display()))?;
    Ok(Variant {
        name: word.to_string(),
        arguments,
        environment: Vec::new(),
        refiner: word.to_string(),
        commands: json!((!is_ours).then_some(command)),
    })
}

fn is_program(name: &str) -> bool {
    if name.contains('/') {
        return Path::new(name).is_file();
    }
    on_path(name).is_some()
}
