//! What a run shall do: command line over configuration file over defaults.

use std::path::PathBuf;

use mluc_backbone::Precision;
use mluc_ipc_types::Stage;
use mluc_refiner::{Mode, Settings as RefinerSettings, TrackSettings};
use mluc_runtime::Instance;

use crate::UsageError;
use crate::cli::{Pace, PipelineArgs};
use crate::config::Config;
use crate::nearest::nearest;
use crate::place::Place;

/// Everything, resolved.
#[derive(Clone, Debug)]
pub(crate) struct Settings {
    pub(crate) instance: Instance,
    pub(crate) input: Option<PathBuf>,
    pub(crate) model: String,
    pub(crate) lambda: Option<f32>,
    pub(crate) unknown_min: Option<f32>,
    pub(crate) pace: Pace,
    pub(crate) rate_hz: Option<f64>,
    pub(crate) repeat: bool,
    pub(crate) seconds: Option<f64>,
    pub(crate) budget_ms: Option<u64>,
    pub(crate) precision: Precision,
    pub(crate) verify_mapping: bool,
    pub(crate) refiner: RefinerSettings,
    /// Temporal voting of unknown objects.
    pub(crate) track: Option<TrackSettings>,
    pub(crate) threads: [usize; 4],
    pub(crate) commands: [Option<Vec<String>>; 4],
    /// Stages that the user starts and replaces.
    pub(crate) externals: [bool; 4],
    pub(crate) places: [Place; 4],
    /// Variables that the stages find in their environment, for measurements.
    pub(crate) environment: Vec<(&'static str, String)>,
    config: Option<PathBuf>,
}

/// Two cores: the backbone uses both, the others take turns.
const THREADS: [usize; 4] = [1, 2, 1, 1];
/// A frame that takes two periods of a 10 Hz sensor.
const BUDGET_MS: u64 = 200;

impl Settings {
    pub(crate) fn resolve(args: PipelineArgs) -> anyhow::Result<Settings> {
        let config = match &args.config {
            Some(path) => Config::read(path)?,
            None => Config::default(),
        };
        let pace = args.pace.or(config.pace).unwrap_or_default();
        let name = args.instance.or(config.instance);
        let name = name.as_deref().unwrap_or(Instance::DEFAULT);
        let tables = &config.stages;
        let tables = [
            &tables.ingest,
            &tables.backbone,
            &tables.head,
            &tables.refiner,
        ];
        let mut threads = THREADS;
        for (threads, table) in threads.iter_mut().zip(tables) {
            *threads = table.threads.unwrap_or(*threads);
        }
        for word in &args.threads {
            let (stage, count) = stage_threads(word)?;
            threads[stage as usize] = count;
        }
        let mut externals = tables.map(|table| table.external);
        for name in &args.without {
            externals[stage_named(name)? as usize] = true;
        }
        let mut refiner = config.refiner.unwrap_or_default();
        if let Some(mode) = &args.refiner_mode {
            refiner.mode = refiner_mode(mode)?;
        }
        let settings = Settings {
            instance: Instance::new(name).map_err(|e| UsageError(e.to_string()))?,
            input: args.input.or(config.input),
            model: args
                .model
                .or(config.model)
                .unwrap_or_else(|| "kitti".to_string()),
            lambda: args.lambda.or(config.lambda),
            unknown_min: args.unknown_min.or(config.unknown_min),
            pace,
            rate_hz: args.rate.or(config.rate_hz),
            repeat: args.repeat,
            seconds: args.seconds,
            budget_ms: args
                .budget_ms
                .or(config.budget_ms)
                .or((pace == Pace::Sensor).then_some(BUDGET_MS)),
            precision: match args.precision.or(config.precision) {
                Some(word) => word
                    .parse()
                    .map_err(|cause| UsageError(format!("precision: {cause}")))?,
                None => Precision::default(),
            },
            verify_mapping: args.verify_mapping,
            refiner,
            track: config.track.or(args.track.then(TrackSettings::default)),
            threads,
            commands: tables.map(|table| table.command.clone()),
            externals,
            places: tables.map(|table| Place {
                cpus: table.cpus.clone(),
                priority: table.priority,
            }),
            environment: Vec::new(),
            config: args.config,
        };
        settings.check()?;
        Ok(settings)
    }

    fn check(&self) -> Result<(), UsageError> {
        let positive = |name: &str, value: Option<f64>, max: f64| match value {
            Some(value) if !(value > 0.0 && value <= max) => Err(UsageError(format!(
                "{name} must be above 0 and at most {max}, found {value}"
            ))),
            _ => Ok(()),
        };
        positive("rate", self.rate_hz, 1000.0)?;
        positive("seconds", self.seconds, 1e7)?;
        if let Some(lambda) = self.lambda
            && !(0.0..=100.0).contains(&lambda)
        {
            return Err(UsageError(format!(
                "lambda must be 0 to 100, found {lambda}"
            )));
        }
        if let Some(p) = self.unknown_min
            && !(0.0..=1.0).contains(&p)
        {
            return Err(UsageError(format!("unknown_min must be 0 to 1, found {p}")));
        }
        for (stage, &threads) in Stage::ALL.iter().zip(&self.threads) {
            if !(1..=256).contains(&threads) {
                return Err(UsageError(format!(
                    "threads of {} must be 1 to 256, found {threads}",
                    stage.name()
                )));
            }
        }
        for (stage, place) in Stage::ALL.iter().zip(&self.places) {
            place.check(stage.name())?;
        }
        for (stage, (command, external)) in Stage::ALL
            .iter()
            .zip(self.commands.iter().zip(self.externals))
        {
            if command.is_some() && external {
                return Err(UsageError(format!(
                    "stage {} has a command and is external: one of them starts it",
                    stage.name()
                )));
            }
        }
        match self.commands.iter().flatten().any(Vec::is_empty) {
            true => Err(UsageError(
                "a stage's command must name a program".to_string(),
            )),
            false => Ok(()),
        }
    }

    /// The arguments that make `mluc stage` resolve to the same settings.
    pub(crate) fn stage_arguments(&self, stage: Stage) -> Vec<String> {
        let mut arguments = vec!["stage".to_string(), stage.name().to_string()];
        let mut add = |key: &str, value: Option<String>| {
            if let Some(value) = value {
                arguments.extend([format!("--{key}"), value]);
            }
        };
        add("instance", Some(self.instance.name().to_string()));
        add("model", Some(self.model.clone()));
        add(
            "config",
            self.config.as_ref().map(|path| path.display().to_string()),
        );
        let pace = match self.pace {
            Pace::Sensor => "sensor",
            Pace::Complete => "complete",
        };
        add("pace", Some(pace.to_string()));
        add("lambda", self.lambda.map(|v| v.to_string()));
        add("unknown-min", self.unknown_min.map(|v| v.to_string()));
        add("refiner-mode", Some(self.refiner.mode.name().to_string()));
        add("precision", Some(self.precision.to_string()));
        add("budget-ms", self.budget_ms.map(|v| v.to_string()));
        add(
            "threads",
            Some(format!("{}={}", stage.name(), self.threads[stage as usize])),
        );
        if stage == Stage::Ingest {
            add(
                "input",
                self.input.as_ref().map(|path| path.display().to_string()),
            );
            add("rate", self.rate_hz.map(|v| v.to_string()));
            add("seconds", self.seconds.map(|v| v.to_string()));
        }
        if stage == Stage::Ingest && self.repeat {
            arguments.push("--loop".to_string());
        }
        if self.track.is_some() {
            arguments.push("--track".to_string());
        }
        for (stage, _) in Stage::ALL
            .iter()
            .zip(self.externals)
            .filter(|(_, external)| *external)
        {
            arguments.extend(["--without".to_string(), stage.name().to_string()]);
        }
        if self.verify_mapping {
            arguments.push("--verify-mapping".to_string());
        }
        arguments
    }
}

/// A stage by its name, or the nearest one in the error.
pub(crate) fn stage_named(name: &str) -> Result<Stage, UsageError> {
    Stage::from_name(name).ok_or_else(|| {
        let names = Stage::ALL.map(Stage::name);
        let hint =
            nearest(name, names).map_or(String::new(), |near| format!("; did you mean '{near}'?"));
        UsageError(format!(
            "no stage '{name}': there are {}{hint}",
            names.join(", ")
        ))
    })
}

fn stage_threads(word: &str) -> Result<(Stage, usize), UsageError> {
    let bad = || {
        UsageError(format!(
            "--threads {word}: expected STAGE=N, backbone=2 for instance"
        ))
    };
    let (name, count) = word.split_once('=').ok_or_else(bad)?;
    Ok((stage_named(name)?, count.parse().map_err(|_| bad())?))
}

fn refiner_mode(name: &str) -> Result<Mode, UsageError> {
    Mode::from_name(name).ok_or_else(|| {
        let names = Mode::ALL.map(Mode::name);
        let hint =
            nearest(name, names).map_or(String::new(), |near| format!("; did you mean '{near}'?"));
        UsageError(format!(
            "no refiner mode '{name}': there are {}{hint}",
            names.join(", ")
        ))
    })
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;
    use crate::cli::{Cli, Command};

    fn resolved(arguments: &[&str]) -> anyhow::Result<Settings> {
        let cli = Cli::try_parse_from(["mluc", "up"].iter().chain(arguments)).unwrap();
        let Command::Up(args) = cli.command else {
            panic!("not up")
        };
        Settings::resolve(args)
    }

    #[test]
    fn a_stage_resolves_to_what_up_resolved_to() {
        let up = resolved(&[
            "--input",
            "a/b",
            "--model",
            "udi",
            "--pace",
            "complete",
            "--rate",
            "5",
            "--loop",
            "--seconds",
            "9",
            "--instance",
            "x",
            "--lambda",
            "1.25",
            "--unknown-min",
            "0.75",
            "--refiner-mode",
            "literal",
            "--verify-mapping",
            "--track",
            "--threads",
            "ingest=3",
            "--without",
            "refiner",
        ])
        .unwrap();
        let arguments = up.stage_arguments(Stage::Ingest);
        let cli =
            Cli::try_parse_from(std::iter::once("mluc".to_string()).chain(arguments)).unwrap();
        let Command::Stage(args) = cli.command else {
            panic!("not stage")
        };
        assert_eq!(args.name, "ingest");
        let stage = Settings::resolve(args.pipeline).unwrap();
        assert_eq!(format!("{stage:?}"), format!("{up:?}"));
    }

    #[test]
    fn what_makes_no_sense_is_a_usage_error() {
        for arguments in [
            ["--rate", "0"],
            ["--rate", "NaN"],
            ["--seconds", "-1"],
            ["--lambda", "-0.5"],
            ["--unknown-min", "1.5"],
            ["--threads", "backbone"],
            ["--threads", "bakbone=2"],
            ["--threads", "head=0"],
            ["--instance", "a/b"],
            ["--refiner-mode", "corected"],
            ["--without", "refner"],
        ] {
            let (key, value) = (arguments[0], arguments[1]);
            let error = resolved(&[&format!("{key}={value}")]).unwrap_err();
            assert!(
                error.downcast_ref::<UsageError>().is_some(),
                "{arguments:?}: {error}"
            );
        }
        let error = resolved(&["--refiner-mode", "corected"])
            .unwrap_err()
            .to_string();
        assert!(error.contains("did you mean 'corrected'?"), "{error}");
    }
}
