//! What a run shall do: one document. The configuration file has its form, `mluc config --print` shows it, and the supervisor
//! hands it to the stages. `docs/configuration.md` describes every key.

use crate::UsageError;
use clap::ValueEnum;
use mluc_backbone::Precision;
use mluc_ipc_types::Stage;
use mluc_kernels::Level;
use mluc_model::{HeadKind, Model, ScoreMin, SensorProfile};
use mluc_refiner::{RobotSettings, Settings as RefinerSettings, TrackSettings, Variant};
use mluc_runtime::Instance;
use mluc_sources::{Lidar, Open, Source, files::Layout, is_incomplete, ros2_topic};
use serde::{Deserialize, Serialize};
use smart_default::SmartDefault;
use std::{collections::BTreeSet, f64::consts::TAU, ops::Index, path::PathBuf};
use toml::Table;

/// The model where none is named, of every command: it takes any spinning LiDAR and looks all around.
pub const DEFAULT_MODEL: &str = "any-open";
/// A frame that takes two periods of a 10 Hz sensor.
const BUDGET_MS: u64 = 200;
/// Half a period of 10 Hz: so far apart are turns of sensors that do not wait for each other.
const TOLERANCE_MS: u64 = 50;
/// Enough for a scan that is set aside after its second kill, and for the next one. A guess.
const RESTART_LIMIT: u32 = 5;
/// Threads of backbone and head: two cores, which the other stages share.
const NETWORK_THREADS: usize = 2;

/// When the next frame enters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum Pace {
    /// At the sensor's rate; a newer scan replaces a waiting one.
    #[default]
    Sensor,
    /// When the objects of the last frame are published; no scan is replaced.
    Complete,
}

/// What is published: the model's manifest has the scores of each, chosen on validation scans.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum Profile {
    /// Few false objects: at most 0.1 unknown and 0.2 known per scan, on simulated validation scans.
    Quiet,
    /// Some false objects: at most 0.3 unknown and 0.5 known per scan, on simulated validation scans.
    #[default]
    Balanced,
    /// All objects, without a lowest score.
    All,
}

impl Profile {
    /// The model's scores; `None`: it has none for this profile and this way of scoring unknown objects.
    pub(crate) fn score_min(self, model: &Model, variant: Variant) -> Option<ScoreMin> {
        let profiles = model.manifest.thresholds.profiles.as_ref();
        let profiles = profiles.filter(|_| variant == Variant::default());
        match self {
            Profile::Quiet => profiles.map(|profiles| profiles.quiet),
            Profile::Balanced => profiles.map(|profiles| profiles.balanced),
            Profile::All => Some(ScoreMin { both_readings: true, ..ScoreMin::default() }),
        }
    }
}

/// What becomes of a run when a stage dies again and again without a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RestartPolicy {
    /// The run ends with an error.
    #[default]
    End,
    /// The other stages run on, and the stage is tried again every 5 s.
    Degraded,
}

/// Everything that can be set.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, SmartDefault)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Name of this pipeline.
    #[serde(with = "by_name")]
    #[default(Instance::new(Instance::DEFAULT).expect("a plain name"))]
    pub instance: Instance,
    /// What ingest reads: scans, a capture, a recording, a live sensor or a topic.
    pub input: Option<PathBuf>,
    /// `[[lidar]]`: in its place several sensors whose scans are merged; the first begins the frames.
    pub lidar: Vec<Lidar>,
    /// Between the times of scans in one frame, at most.
    #[default(TOLERANCE_MS)]
    pub tolerance_ms: u64,
    /// `[layout]`: how files of points are read.
    pub layout: Layout,
    /// Name of a built-in model, or a model file.
    #[default(DEFAULT_MODEL.to_string())]
    pub model: String,
    /// Threshold of the gate on the normalised EDS, for a model without a logit of the unknown.
    pub lambda: Option<f64>,
    /// Probability of being unknown from which a box is a candidate, for a model with such a logit.
    pub unknown_min: Option<f64>,
    /// What is published.
    pub profile: Profile,
    /// Known objects below this score are not published; unset: the profile's.
    pub min_score: Option<f64>,
    /// The same of unknown objects.
    pub min_unknown_score: Option<f64>,
    /// When the next frame enters.
    pub pace: Pace,
    /// Frames a second at pace `sensor`; unset: the stamps beside the scans, else 10.
    pub rate_hz: Option<f64>,
    /// Begin again after the last scan.
    #[serde(rename = "loop")]
    pub repeat: bool,
    /// End so many seconds after all stages are ready.
    pub seconds: Option<f64>,
    /// Objects that leave later are flagged `late`.
    pub budget_ms: Option<u64>,
    /// A line on stdout, besides the frames', when the pipeline's state changes.
    pub status_lines: bool,
    /// Arithmetic of the backbone.
    #[default(Precision::Auto)]
    pub precision: Precision,
    /// Vector instructions of a less capable processor, to measure its speed; unset: the fastest of this one.
    pub instruction_set: Option<String>,
    /// Check that each payload lies in shared memory.
    pub verify_mapping: bool,
    /// Times in a row that a stage may die by itself without a frame between.
    #[default(RESTART_LIMIT)]
    pub restart_limit: u32,
    /// What happens when a stage reaches `restart_limit`.
    pub on_restart_limit: RestartPolicy,
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
}

/// `[sensor]`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SensorSettings {
    /// Profile of the sensor: a product, or a TOML file; scans that contradict it are flagged.
    pub profile: Option<String>,
    /// What others are told; empty: the profile's name.
    pub name: String,
    /// Pose of the scans' frame in the robot's base frame: x, y, z in m, roll, pitch, yaw in rad; unset: zeros, or the first lidar's.
    pub extrinsics: Option<[f64; 6]>,
}

impl SensorSettings {
    /// The profile, if one is given.
    pub(crate) fn load(&self) -> Result<Option<SensorProfile>, UsageError> {
        let profile = self.profile.as_deref().map(SensorProfile::load).transpose();
        profile.map_err(|error| UsageError(error.to_string()))
    }
}

/// `[stages]`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, SmartDefault)]
#[serde(deny_unknown_fields, default)]
#[allow(missing_docs)]
pub struct Stages {
    pub ingest: StageSettings,
    #[default(StageSettings::of_network())]
    pub backbone: StageSettings,
    #[default(StageSettings::of_network())]
    pub head: StageSettings,
    pub refiner: StageSettings,
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

/// How one stage runs.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, SmartDefault)]
#[serde(deny_unknown_fields, default)]
pub struct StageSettings {
    /// Another program in the stage's place: program and arguments.
    pub command: Option<Vec<String>>,
    /// Folder in which the command runs; in a file it is relative to the file, and the file's own where it is not set.
    pub directory: Option<PathBuf>,
    /// Left to the user, who starts and replaces it.
    pub external: bool,
    /// Threads that compute.
    #[default(1)]
    pub threads: usize,
    /// Cores that it may run on, counted from 0; unset: all.
    pub cpus: Option<Vec<usize>>,
    /// Real-time priority (SCHED_FIFO), 1 to 99; unset: none.
    pub priority: Option<u8>,
    /// Keep its memory from being paged out.
    pub lock_memory: bool,
    /// Touch shared memory before the first frame does.
    #[default(true)]
    pub prefault: bool,
    /// Frames that need longer, ms, from the publication of the stage's input to that of its result, are counted and logged.
    pub budget_ms: Option<u64>,
    /// Longest time without a heartbeat of a ready stage, ms, except during its first frame; at least twice its longest frame. Then it is killed and
    /// restarted. 0: never.
    #[default(1000)]
    pub heartbeat_max_ms: u64,
    /// Longest time from its start until it is ready, and longest silence during its first frame, ms. Then it is killed and restarted. 0: no limit.
    #[default(30_000)]
    pub start_max_ms: u64,
}

impl Settings {
    /// Whether ingest reads a ROS 2 topic, which the program `mluc-ros2` alone opens.
    pub(crate) fn reads_ros2(&self) -> bool {
        self.inputs().any(|input| ros2_topic(input).is_some())
    }

    fn inputs(&self) -> impl Iterator<Item = &PathBuf> {
        self.lidar.iter().map(|lidar| &lidar.input).chain(&self.input)
    }

    /// Opens what ingest reads; `None`: nothing is given.
    pub(crate) fn source(&self, open: Open) -> anyhow::Result<Option<Source>> {
        let frame = self.sensor.extrinsics.unwrap_or_default();
        let mut layout = self.layout.clone();
        if layout.deskew {
            layout.base_from_sensor = frame;
        }
        let source = match &self.input {
            Some(input) => open(input, &layout, self.repeat),
            None if self.lidar.is_empty() => return Ok(None),
            None => Source::merge(&self.lidar, &layout, frame, self.tolerance_ms, open),
        };
        source.map(Some)
    }

    pub(crate) fn complete(&mut self) {
        if self.pace == Pace::Sensor {
            self.budget_ms.get_or_insert(BUDGET_MS);
        }
        self.refiner.robot = self.robot;
        let sensor = &mut self.sensor;
        let first = self.lidar.first().map(|lidar| lidar.extrinsics);
        sensor.extrinsics = sensor.extrinsics.or(first);
        if let (Some(profile), "") = (&sensor.profile, sensor.name.as_str()) {
            let stem = std::path::Path::new(profile).file_stem();
            sensor.name = stem.unwrap_or_default().to_string_lossy().into_owned();
        }
    }

    /// The gate's threshold and the scores of the profile where none were given: the model's. False: it has no such scores.
    pub(crate) fn complete_from(&mut self, model: &Model) -> bool {
        let thresholds = &model.manifest.thresholds;
        let (threshold, default) = match model.manifest.network.head {
            HeadKind::Open => (&mut self.unknown_min, thresholds.unknown_min),
            _ => (&mut self.lambda, thresholds.eds_normalised_max),
        };
        // Through its text: the nearest f64 of an f32 has digits that nobody wrote.
        threshold.get_or_insert(default.to_string().parse().unwrap_or(f64::from(default)));
        let scores = self.profile.score_min(model, self.refiner.variant);
        let mut score_min = scores.unwrap_or_default();
        let own = [
            (&mut score_min.known, self.min_score),
            (&mut score_min.unknown, self.min_unknown_score),
        ];
        for (least, given) in own {
            *least = given.map_or(*least, |score| score as f32);
        }
        self.refiner.score_min = score_min;
        scores.is_some() || self.min_score.and(self.min_unknown_score).is_some()
    }

    /// What `instruction_set` names.
    pub(crate) fn level(&self) -> Result<Option<Level>, UsageError> {
        let Some(name) = &self.instruction_set else {
            return Ok(None);
        };
        let all = Level::all();
        if let Some(level) = all.iter().find(|level| level.name() == name) {
            return Ok(Some(*level));
        }
        let names: Vec<_> = all.iter().map(|level| level.name()).collect();
        let names = names.join(", ");
        Err(UsageError(format!("instruction_set: this processor has {names}, found {name}")))
    }

    pub(crate) fn check(&self) -> Result<(), UsageError> {
        let budget_ms = self.budget_ms.map(|ms| ms as f64);
        let lidars = self.lidar.len() as f64;
        let mut ranges = vec![
            ("rate_hz", self.rate_hz, 0.001, 1000.0),
            ("seconds", self.seconds, 0.001, 1e7),
            ("lambda", self.lambda, 0.0, 1e6),
            ("unknown_min", self.unknown_min, 0.0, 1.0),
            ("min_score", self.min_score, 0.0, 1.0),
            ("min_unknown_score", self.min_unknown_score, 0.0, 1e6),
            ("budget_ms", budget_ms, 0.0, 600_000.0),
            ("tolerance_ms", Some(self.tolerance_ms as f64), 0.0, 500.0),
            // As many as a sensor profile has `units`.
            ("[[lidar]] tables", Some(lidars), 0.0, 4.0),
            ("restart_limit", Some(self.restart_limit.into()), 1.0, 1e6),
        ];
        let extrinsics = self.sensor.extrinsics.unwrap_or_default();
        ranges.extend(extrinsics.map(|v| ("extrinsics of [sensor]", Some(v), -1e6, 1e6)));
        for [place_m @ .., roll, pitch, yaw] in self.lidar.iter().map(|lidar| lidar.extrinsics) {
            ranges.extend(place_m.map(|v| ("extrinsics of [[lidar]], in m,", Some(v), -1e6, 1e6)));
            let angles = [roll, pitch, yaw].map(Some);
            ranges.extend(angles.map(|v| ("extrinsics of [[lidar]], in rad,", v, -TAU, TAU)));
        }
        for (key, value, low, high) in ranges {
            if let Some(value) = value.filter(|value| !(low..=high).contains(value)) {
                return refused(format!("{key} must be {low} to {high}, found {value}"));
            }
        }
        if let Some(input) = self.inputs().find(|input| is_incomplete(input)) {
            let kinds = "scans, udp:PORT, udp:ADDRESS:PORT, ros2:/TOPIC or follow:DIR";
            let input = input.display();
            return refused(format!("input: expected {kinds}, found '{input}'"));
        }
        let mut names = self.lidar.iter().map(|lidar| &lidar.name);
        let mut seen = BTreeSet::new();
        if let Some(name) = names.find(|name| name.is_empty() || !seen.insert(*name)) {
            let expected = "expected a different one for each";
            return refused(format!("name of [[lidar]]: {expected}, found '{name}'"));
        }
        self.level()?;
        if !self.lidar.is_empty() && (self.input.is_some() || self.repeat) {
            return refused("[[lidar]] goes without input and loop".to_string());
        }
        self.layout.check().map_err(|error| UsageError(format!("[layout] {error}")))?;
        for stage in Stage::ALL {
            self.stages[stage].check(stage.name())?;
        }
        self.refiner.check().map_err(|error| UsageError(format!("[refiner] {error}")))?;
        let track = self.track.map_or(Ok(()), |track| track.check());
        track.map_err(|error| UsageError(error.to_string()))
    }
}

impl StageSettings {
    fn of_network() -> StageSettings {
        StageSettings { threads: NETWORK_THREADS, ..StageSettings::default() }
    }

    fn check(&self, stage: &str) -> Result<(), UsageError> {
        let threads = self.threads;
        if !(1..=256).contains(&threads) {
            return refused(format!("threads of {stage} must be 1 to 256, found {threads}"));
        }
        let limits = [
            ("budget_ms", self.budget_ms.unwrap_or(0)),
            ("heartbeat_max_ms", self.heartbeat_max_ms),
            ("start_max_ms", self.start_max_ms),
        ];
        if let Some((key, ms)) = limits.into_iter().find(|(_, ms)| *ms > 600_000) {
            return refused(format!("{key} of {stage} must be 0 to 600000, found {ms}"));
        }
        match &self.command {
            Some(_) if self.external => refused(format!(
                "stage {stage} has a command and is external: one of them starts it"
            )),
            Some(words) if words.is_empty() => {
                refused(format!("the command of stage {stage} must name a program"))
            }
            Some(_) if self.lock_memory || !self.prefault => refused(format!(
                "lock_memory and prefault of {stage} are for our own stage: its command decides on its memory"
            )),
            _ => self.check_placement(stage),
        }
    }
}

fn refused(text: String) -> Result<(), UsageError> {
    Err(UsageError(text))
}

/// An instance as its name.
mod by_name {
    use super::Instance;
    use serde::{Deserialize, Deserializer, Serializer, de::Error};

    pub(super) fn serialize<S: Serializer>(value: &Instance, to: S) -> Result<S::Ok, S::Error> {
        to.serialize_str(value.name())
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Instance, D::Error> {
        Instance::new(&String::deserialize(from)?).map_err(D::Error::custom)
    }
}

/// `true`, `false`, or a table that says how.
mod switch {
    use super::TrackSettings;
    use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error};
    use toml::Value;

    type Switch = Option<TrackSettings>;

    pub(super) fn serialize<S: Serializer>(value: &Switch, to: S) -> Result<S::Ok, S::Error> {
        match value {
            Some(table) => table.serialize(to),
            None => to.serialize_bool(false),
        }
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Switch, D::Error> {
        match Value::deserialize(from)? {
            Value::Boolean(is_on) => Ok(is_on.then(TrackSettings::default)),
            Value::Table(table) => {
                table.try_into().map(Some).map_err(|error| D::Error::custom(error.message()))
            }
            other => {
                let expected = "expected true, false or a table";
                Err(D::Error::custom(format!("{expected}, found {other}")))
            }
        }
    }
}
