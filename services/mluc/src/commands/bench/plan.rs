//! What shall be measured, resolved and checked before any process is started.

use std::path::PathBuf;
use std::time::Duration;

use mluc_ipc_types::Stage;
use mluc_model::Model;
use mluc_refiner::Mode;
use serde_json::{Map, Value, json};

use super::arguments::{Instrumentation, RunArgs};
use super::labels::Labels;
use super::machine::available_mib;
use super::scenario::{BenchTable, LoadTable};
use super::trace::TraceWish;
use crate::bundled::BundledScans;
use crate::cli::{Pace, PipelineArgs};
use crate::config::Config;
use crate::settings::Settings;
use crate::source::Source;
use crate::stages::STAMPS_VARIABLE;
use crate::{UsageError, model};

const SECONDS: f64 = 20.0;
const WARM_UP_SECONDS: f64 = 2.0;
const RATE_HZ: f64 = 10.0;
/// When two variants take turns: each starts so often.
const ROUNDS_COMPARED: u32 = 4;
const ROUNDS_MAX: u32 = 1000;
const FLOOR_ROUNDS: usize = 200;
const PATIENCE_SECONDS: f64 = 60.0;
/// A guess: a million frames at 10 Hz.
const SECONDS_MAX: f64 = 100_000.0;

/// One thing that is measured.
pub(super) struct Variant {
    /// For tables, and, when there are two, of its folder.
    pub(super) name: String,
    pub(super) settings: Settings,
}

/// A whole measurement.
pub(super) struct Plan {
    pub(super) variants: Vec<Variant>,
    pub(super) out: PathBuf,
    pub(super) rate_hz: f64,
    pub(super) seconds: f64,
    pub(super) warm_up_seconds: f64,
    pub(super) rounds: u32,
    pub(super) floor_rounds: usize,
    pub(super) patience: Duration,
    pub(super) load: LoadTable,
    pub(super) instrumentation: Instrumentation,
    pub(super) trace: Option<TraceWish>,
    pub(super) labels: Labels,
    pub(super) model: Model,
    /// For the page's head.
    pub(super) scans: String,
    // Removed from the disk when the plan goes.
    _bundled: Option<BundledScans>,
}

impl Plan {
    pub(super) fn resolve(args: RunArgs) -> anyhow::Result<Plan> {
        let config = match &args.scenario {
            Some(path) => Config::read(path)?,
            None => Config::default(),
        };
        if config.pace.is_some_and(|pace| pace != Pace::Sensor) {
            return Err(UsageError(
                "a measurement is open loop: pace = \"complete\" waits for the pipeline and hides its stalls; take it out of the scenario".to_string(),
            )
            .into());
        }
        let table = config.bench.clone().unwrap_or_default();
        table.load.check(available_mib())?;
        let given = args.input.clone().or(config.input.clone());
        let bundled = match given {
            Some(_) => None,
            None => Some(BundledScans::write("bench")?),
        };
        let input = given.or_else(|| bundled.as_ref().map(|scans| scans.folder().to_path_buf()));
        let input = input.unwrap_or_default();
        let model_name = args
            .model
            .clone()
            .or(config.model.clone())
            .unwrap_or_else(|| {
                let word = if bundled.is_some() { "udi" } else { "kitti" };
                word.to_string()
            });
        let source = Source::find(&input)?;
        let scans = describe_scans(&source, bundled.is_some(), &input);
        let rate_hz = args.rate.or(config.rate_hz).unwrap_or(RATE_HZ);
        let numbers = Numbers::resolve(&args, &table)?;
        let settings = Settings::resolve(PipelineArgs {
            input: Some(input.clone()),
            model: Some(model_name.clone()),
            pace: Some(Pace::Sensor),
            rate: Some(rate_hz),
            repeat: true,
            config: args.scenario.clone(),
            precision: args.precision.clone(),
            threads: args.threads.clone(),
            ..PipelineArgs::default()
        })?;
        let instrumentation = args.instrumentation.unwrap_or_default();
        let variants = variants(&args, instrumentation, settings)?;
        let rounds = numbers.rounds.unwrap_or(if variants.len() > 1 {
            ROUNDS_COMPARED
        } else {
            1
        });
        Ok(Plan {
            trace: TraceWish::resolve(&args, variants.len())?,
            variants,
            out: args.out.unwrap_or_else(|| "mluc-bench".into()),
            rate_hz,
            seconds: numbers.seconds,
            warm_up_seconds: numbers.warm_up_seconds,
            rounds,
            floor_rounds: numbers.floor_rounds,
            patience: Duration::from_secs_f64(numbers.patience_seconds),
            load: table.load,
            instrumentation,
            labels: Labels::beside(&input),
            model: model::load(&model_name)?,
            scans,
            _bundled: bundled,
        })
    }

    /// Measured seconds of one round.
    pub(super) fn round_seconds(&self) -> f64 {
        self.seconds / f64::from(self.rounds)
    }

    /// For the report: what ran.
    pub(super) fn describe(&self, variant: &Variant) -> Map<String, Value> {
        let settings = &variant.settings;
        let by_stage = |of: &dyn Fn(usize) -> Value| -> Map<String, Value> {
            let each = Stage::ALL
                .iter()
                .map(|&stage| (stage.name().to_string(), of(stage as usize)));
            each.filter(|(_, value)| !value.is_null()).collect()
        };
        let manifest = &self.model.manifest;
        let value = json!({
            "scans": self.scans,
            "rate_hz": self.rate_hz,
            "seconds": self.seconds,
            "warm_up_seconds": self.warm_up_seconds,
            "rounds": self.rounds,
            "model": settings.model,
            "model_fingerprint": format!("{:016x}", self.model.fingerprint),
            "profile": manifest.network.profile.to_string(),
            "precision": settings.precision.to_string(),
            "refiner": settings.refiner.mode.name(),
            "threads": by_stage(&|stage| json!(settings.threads[stage])),
            "cpus": by_stage(&|stage| json!(settings.places[stage].cpus)),
            "priorities": by_stage(&|stage| json!(settings.places[stage].priority)),
            "commands": by_stage(&|stage| json!(settings.commands[stage])),
            "load": self.load,
            "command": std::env::args().collect::<Vec<_>>().join(" "),
        });
        match value {
            Value::Object(map) => map,
            _ => Map::new(),
        }
    }
}

/// The numbers of the command line over those of the table over the defaults.
struct Numbers {
    seconds: f64,
    warm_up_seconds: f64,
    rounds: Option<u32>,
    floor_rounds: usize,
    patience_seconds: f64,
}

impl Numbers {
    fn resolve(args: &RunArgs, table: &BenchTable) -> Result<Numbers, UsageError> {
        let within =
            |name: &str, value: f64, least: f64| match (least..=SECONDS_MAX).contains(&value) {
                true => Ok(value),
                false => Err(UsageError(format!(
                    "{name} must be {least} to {SECONDS_MAX}, found {value}"
                ))),
            };
        let rounds = args.rounds.or(table.rounds);
        if let Some(rounds) = rounds
            && !(1..=ROUNDS_MAX).contains(&rounds)
        {
            return Err(UsageError(format!(
                "rounds must be 1 to {ROUNDS_MAX}, found {rounds}"
            )));
        }
        Ok(Numbers {
            seconds: within(
                "seconds",
                args.seconds.or(table.seconds).unwrap_or(SECONDS),
                0.1,
            )?,
            warm_up_seconds: within(
                "warm-up",
                args.warm_up
                    .or(table.warm_up_seconds)
                    .unwrap_or(WARM_UP_SECONDS),
                0.0,
            )?,
            rounds,
            floor_rounds: args
                .floor_rounds
                .or(table.floor_rounds)
                .unwrap_or(FLOOR_ROUNDS)
                .min(1_000_000),
            patience_seconds: within(
                "patience",
                args.patience
                    .or(table.patience_seconds)
                    .unwrap_or(PATIENCE_SECONDS),
                0.1,
            )?,
        })
    }
}

fn describe_scans(source: &Source, is_bundled: bool, input: &std::path::Path) -> String {
    let count = source.scans.len();
    match is_bundled {
        true => format!("{count} bundled simulated scans, in turn"),
        false => format!("{count} of {}, in turn", input.display()),
    }
}

/// One, or the two that take turns.
fn variants(
    args: &RunArgs,
    instrumentation: Instrumentation,
    settings: Settings,
) -> anyhow::Result<Vec<Variant>> {
    let switched = |is_on: bool| {
        let mut settings = settings.clone();
        if !is_on {
            settings
                .environment
                .push((STAMPS_VARIABLE, "off".to_string()));
        }
        settings
    };
    if instrumentation == Instrumentation::Compare {
        if args.refiner.len() > 1 {
            return Err(UsageError("--instrumentation compare and two --refiner cannot be told apart: one after the other, please".to_string()).into());
        }
        let refined = |settings: Settings| match args.refiner.first() {
            Some(word) => with_refiner(settings, word),
            None => Ok(settings),
        };
        return Ok(vec![
            Variant {
                name: "instrumented".to_string(),
                settings: refined(switched(true))?,
            },
            Variant {
                name: "bare".to_string(),
                settings: refined(switched(false))?,
            },
        ]);
    }
    let settings = switched(instrumentation == Instrumentation::On);
    match &args.refiner[..] {
        [] => Ok(vec![Variant {
            name: settings.refiner.mode.name().to_string(),
            settings,
        }]),
        [_] | [_, _] => args
            .refiner
            .iter()
            .map(|word| {
                Ok(Variant {
                    name: word.clone(),
                    settings: with_refiner(settings.clone(), word)?,
                })
            })
            .collect(),
        more => Err(UsageError(format!(
            "--refiner can be given once or twice, found {} times",
            more.len()
        ))
        .into()),
    }
}

/// A name of ours, or a program with arguments.
fn with_refiner(mut settings: Settings, word: &str) -> anyhow::Result<Settings> {
    let command: Vec<String> = word.split_whitespace().map(str::to_string).collect();
    match Mode::from_name(word) {
        Some(mode) => {
            settings.refiner.mode = mode;
            settings.commands[Stage::Refiner as usize] = None;
        }
        None if command.first().is_some_and(|program| is_program(program)) => {
            settings.commands[Stage::Refiner as usize] = Some(command);
        }
        None => {
            let names = Mode::ALL.map(Mode::name).join(", ");
            return Err(UsageError(format!(
                "no refiner '{word}': there are {names}, or a program's command"
            ))
            .into());
        }
    }
    Ok(settings)
}

fn is_program(name: &str) -> bool {
    if name.contains('/') {
        return std::path::Path::new(name).is_file();
    }
    let path = std::env::var_os("PATH").unwrap_or_default();
    std::env::split_paths(&path).any(|folder| folder.join(name).is_file())
}
