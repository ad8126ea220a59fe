//! What a run shall do: one document. The configuration file has its form, `mluc config --print` shows it, and the supervisor
//! hands it to the stages. `docs/configuration.md` describes every key.

use std::ops::{Index, IndexMut};
use std::path::PathBuf;

use clap::ValueEnum;
use mluc_backbone::Precision;
use mluc_ipc_types::Stage;
use mluc_model::{HeadKind, Model};
use mluc_refiner::{RobotSettings, Settings as RefinerSettings, TrackSettings};
use mluc_runtime::Instance;
use serde::{Deserialize, Serialize};
use toml::Table;

use crate::UsageError;

/// The model of `up`, `demo`, `doctor` and `mluc-bench` where none is named: its unknown objects are usable on real scans,
/// and it keeps 10 Hz on two cores.
pub const DEFAULT_MODEL: &str = "kitti-open";
/// A frame that takes two periods of a 10 Hz sensor.
const BUDGET_MS: u64 = 200;
/// Threads of the backbone: two cores, which the other stages share.
const BACKBONE_THREADS: usize = 2;

/// When the next frame enters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum Pace {
    /// At the sensor's rate; the newest frame wins.
    #[default]
    Sensor,
    /// When the last one's objects are out; nothing is dropped.
    Complete,
}

/// Everything that can be set.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Name of this pipeline.
    #[serde(with = "by_name")]
    pub instance: Instance,
    /// A scan, or a folder of scans.
    pub input: Option<PathBuf>,
    /// Name of an embedded model, or a model file.
    pub model: String,
    /// Threshold of the gate on the normalised EDS, for a model without a logit of the unknown.
    pub lambda: Option<f64>,
    /// Probability of being unknown from which a box is a candidate, for a model with such a logit.
    pub unknown_min: Option<f64>,
    /// When the next frame enters.
    pub pace: Pace,
    /// Frames a second at pace `sensor`; unset: the stamps beside the scans, else 10.
    pub rate_hz: Option<f64>,
    /// Begin again after the last scan.
    #[serde(rename = "loop")]
    pub repeat: bool,
    /// End after so many seconds of input.
    pub seconds: Option<f64>,
    /// Objects that leave later are flagged `late`.
    pub budget_ms: Option<u64>,
    /// Arithmetic of the backbone.
    #[serde(with = "by_name")]
    pub precision: Precision,
    /// Check that each payload lies in shared memory.
    pub verify_mapping: bool,
    /// `[stages.NAME]`.
    pub stages: Stages,
    /// `[refiner]`: the algorithm's own settings.
    pub refiner: RefinerSettings,
    /// `[robot]`: what the robot may drive over or into.
    pub robot: RobotSettings,
    /// `[sensor]`: which sensor, and where it sits; told to all stages and consumers in the topic `run`.
    pub sensor: SensorSettings,
    /// `[track]`, or `track = true`: temporal voting of unknown objects.
    #[serde(with = "switch")]
    pub track: Option<TrackSettings>,
    /// `[bench]`: how `mluc-bench` measures this configuration. It reads the table.
    #[serde(skip_serializing)]
    pub bench: Option<Table>,
    /// Variables that the stages find in their environment, for measurements.
    #[serde(skip)]
    pub environment: Vec<(&'static str, String)>,
}

impl Default for Settings {
    fn default() -> Settings {
        Settings {
            instance: Instance::new(Instance::DEFAULT).expect("a plain name"),
            input: None,
            model: DEFAULT_MODEL.to_string(),
            lambda: None,
            unknown_min: None,
            pace: Pace::default(),
            rate_hz: None,
            repeat: false,
            seconds: None,
            budget_ms: None,
            precision: Precision::default(),
            verify_mapping: false,
            stages: Stages::default(),
            refiner: RefinerSettings::default(),
            robot: RobotSettings::default(),
            sensor: SensorSettings::default(),
            track: None,
            bench: None,
            environment: Vec::new(),
        }
    }
}

/// `[sensor]`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SensorSettings {
    /// Name of the sensor's profile.
    pub name: String,
    /// Pose of the sensor in the robot's base frame: x, y, z in m, roll, pitch, yaw in rad.
    pub extrinsics: [f64; 6],
}

/// `[stages]`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[allow(missing_docs)]
pub struct Stages {
    pub ingest: StageSettings,
    pub backbone: StageSettings,
    pub head: StageSettings,
    pub refiner: StageSettings,
}

impl Default for Stages {
    fn default() -> Stages {
        let one = StageSettings::default;
        Stages {
            ingest: one(),
            backbone: StageSettings {
                threads: BACKBONE_THREADS,
                ..one()
            },
            head: one(),
            refiner: one(),
        }
    }
}

impl Index<Stage> for Stages {
    type Output = StageSettings;

    fn index(&self, stage: Stage) -> &StageSettings {
        match stage {
            Stage::Ingest => &self.ingest,
            Stage::Backbone => &self.backbone,
            Stage::Head => &self.head,
            Stage::Refiner => &self.refiner,
        }
    }
}

impl IndexMut<Stage> for Stages {
    fn index_mut(&mut self, stage: Stage) -> &mut StageSettings {
        match stage {
            Stage::Ingest => &mut self.ingest,
            Stage::Backbone => &mut self.backbone,
            Stage::Head => &mut self.head,
            Stage::Refiner => &mut self.refiner,
        }
    }
}

/// How one stage runs.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct StageSettings {
    /// Another program in the stage's place: program and arguments.
    pub command: Option<Vec<String>>,
    /// Folder in which the command runs; in a file it is relative to the file, and the file's own where it is not set.
    pub directory: Option<PathBuf>,
    /// Left to the user, who starts and replaces it.
    pub external: bool,
    /// Threads that compute.
    pub threads: usize,
    /// Cores that it may run on, counted from 0; unset: all.
    pub cpus: Option<Vec<usize>>,
    /// Real-time priority (SCHED_FIFO), 1 to 99; unset: none.
    pub priority: Option<u8>,
}

impl Default for StageSettings {
    fn default() -> StageSettings {
        StageSettings {
            command: None,
            directory: None,
            external: false,
            threads: 1,
            cpus: None,
            priority: None,
        }
    }
}

impl Settings {
    /// What depends on other settings.
    pub(crate) fn complete(&mut self) {
        if self.pace == Pace::Sensor {
            self.budget_ms.get_or_insert(BUDGET_MS);
        }
        self.refiner.robot = self.robot;
        let absolute = |path: PathBuf| std::path::absolute(&path).unwrap_or(path);
        self.input = self.input.take().map(absolute);
    }

    /// The gate's threshold where none was given: the model's.
    pub(crate) fn complete_from(&mut self, model: &Model) {
        let manifest = &model.manifest;
        // Through its text: the nearest f64 of an f32 has digits that nobody wrote.
        let written = |value: f32| value.to_string().parse().unwrap_or(f64::from(value));
        match manifest.network.head {
            HeadKind::Open => {
                let default = written(manifest.thresholds.unknown_min);
                self.unknown_min.get_or_insert(default);
            }
            _ => {
                let default = written(manifest.thresholds.eds_normalised_max);
                self.lambda.get_or_insert(default);
            }
        }
    }

    /// Refuses what makes no sense, by its key.
    pub fn check(&self) -> Result<(), UsageError> {
        let within = |key: &str, value: Option<f64>, low: f64, high: f64| match value {
            Some(value) if !(low..=high).contains(&value) => Err(UsageError(format!(
                "{key} must be {low} to {high}, found {value}"
            ))),
            _ => Ok(()),
        };
        within("rate_hz", self.rate_hz, 0.001, 1000.0)?;
        within("seconds", self.seconds, 0.001, 1e7)?;
        within("lambda", self.lambda, 0.0, 100.0)?;
        within("unknown_min", self.unknown_min, 0.0, 1.0)?;
        within(
            "budget_ms",
            self.budget_ms.map(|v| v as f64),
            0.0,
            600_000.0,
        )?;
        for &number in &self.sensor.extrinsics {
            within("extrinsics of [sensor]", Some(number), -1e6, 1e6)?;
        }
        for stage in Stage::ALL {
            self.stages[stage].check(stage.name())?;
        }
        let refused =
            |table: &str, error: mluc_refiner::RefinerError| UsageError(format!("{table}{error}"));
        self.refiner
            .check()
            .map_err(|error| refused("[refiner] ", error))?;
        match &self.track {
            Some(track) => track.check().map_err(|error| refused("", error)),
            None => Ok(()),
        }
    }
}

impl StageSettings {
    fn check(&self, stage: &str) -> Result<(), UsageError> {
        if !(1..=256).contains(&self.threads) {
            return Err(UsageError(format!(
                "threads of {stage} must be 1 to 256, found {}",
                self.threads
            )));
        }
        match &self.command {
            Some(_) if self.external => Err(UsageError(format!(
                "stage {stage} has a command and is external: one of them starts it"
            ))),
            Some(words) if words.is_empty() => Err(UsageError(format!(
                "the command of stage {stage} must name a program"
            ))),
            _ => self.check_placement(stage),
        }
    }
}

/// Values that are written as their names.
mod by_name {
    use super::{Instance, Precision};
    use serde::de::Error;
    use serde::{Deserialize, Deserializer, Serializer};

    pub(super) trait Named: Sized {
        fn name(&self) -> &str;
        fn from_name(name: &str) -> Result<Self, String>;
    }

    impl Named for Instance {
        fn name(&self) -> &str {
            Instance::name(self)
        }

        fn from_name(name: &str) -> Result<Instance, String> {
            Instance::new(name).map_err(|error| error.to_string())
        }
    }

    impl Named for Precision {
        fn name(&self) -> &str {
            Precision::name(*self)
        }

        fn from_name(name: &str) -> Result<Precision, String> {
            let all = Precision::ALL;
            crate::names::named("precision", name, &all, Precision::name).map_err(|e| e.to_string())
        }
    }

    pub(super) fn serialize<T: Named, S: Serializer>(value: &T, to: S) -> Result<S::Ok, S::Error> {
        to.serialize_str(value.name())
    }

    pub(super) fn deserialize<'de, T: Named, D: Deserializer<'de>>(from: D) -> Result<T, D::Error> {
        let name = String::deserialize(from)?;
        T::from_name(&name).map_err(D::Error::custom)
    }
}

/// `true`, `false`, or a table that says how.
mod switch {
    use std::marker::PhantomData;

    use serde::de::value::MapAccessDeserializer;
    use serde::de::{MapAccess, Visitor};
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub(super) fn serialize<T: Serialize, S: Serializer>(
        value: &Option<T>,
        to: S,
    ) -> Result<S::Ok, S::Error> {
        match value {
            Some(table) => table.serialize(to),
            None => to.serialize_bool(false),
        }
    }

    pub(super) fn deserialize<'de, T, D>(from: D) -> Result<Option<T>, D::Error>
    where
        T: Deserialize<'de> + Default,
        D: Deserializer<'de>,
    {
        struct Switch<T>(PhantomData<T>);
        impl<'de, T: Deserialize<'de> + Default> Visitor<'de> for Switch<T> {
            type Value = Option<T>;

            fn expecting(&self, to: &mut std::fmt::Formatter) -> std::fmt::Result {
                to.write_str("true, false or a table")
            }

            fn visit_bool<E>(self, is_on: bool) -> Result<Option<T>, E> {
                Ok(is_on.then(T::default))
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Option<T>, A::Error> {
                T::deserialize(MapAccessDeserializer::new(map)).map(Some)
            }
        }
        from.deserialize_any(Switch(PhantomData))
    }
}
