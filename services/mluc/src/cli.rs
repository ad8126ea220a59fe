//! The command line.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};
use serde::Deserialize;

use crate::commands::{BenchArgs, NeighbourArgs, RefinerTestArgs};

/// Known and unknown objects in LiDAR scans.
#[derive(Debug, Parser)]
#[command(name = "mluc", version)]
pub(crate) struct Cli {
    #[command(subcommand)]
    pub(crate) command: Command,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Run the pipeline on scans; one JSON line a frame on stdout.
    Up(PipelineArgs),
    /// Run the pipeline on bundled simulated scans: objects, latency table, picture.
    Demo(DemoArgs),
    /// Run one stage in this process (`up` starts them by itself).
    Stage(StageArgs),
    /// Say how the stages of a running pipeline are.
    Status(StatusArgs),
    /// Check whether this machine can run the pipeline.
    Doctor(DoctorArgs),
    /// Measure latency, stage by stage, and write a report; `bench compare` judges two.
    Bench(Box<BenchArgs>),
    /// Test any program against the refiner's contract (docs/CONTRACT.md); without one, our own in all modes.
    RefinerTest(RefinerTestArgs),
    /// Start a program that ends with its parent (used by `up` for foreign stages).
    #[command(hide = true)]
    Exec(ExecArgs),
    /// Take CPU and memory from the others (used by `bench` for its load).
    #[command(hide = true)]
    Neighbour(NeighbourArgs),
}

/// When the next frame enters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, ValueEnum)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Pace {
    /// At the sensor's rate; the newest frame wins.
    #[default]
    Sensor,
    /// When the last one's objects are out; nothing is dropped.
    Complete,
}

/// What `up` and `stage` share; everything may stand in the configuration file instead.
#[derive(Args, Clone, Debug, Default)]
pub(crate) struct PipelineArgs {
    /// A folder of KITTI .bin scans (or of `velodyne/`), or one scan.
    #[arg(long)]
    pub(crate) input: Option<PathBuf>,
    /// An embedded model (kitti, kitti-open, udi, udi-open) or a model file [default: kitti].
    #[arg(long)]
    pub(crate) model: Option<String>,
    /// When the next frame enters [default: sensor].
    #[arg(long, value_enum)]
    pub(crate) pace: Option<Pace>,
    /// Frames a second at pace `sensor` [default: timestamps.txt beside the scans, else 10].
    #[arg(long)]
    pub(crate) rate: Option<f64>,
    /// Begin again after the last scan.
    #[arg(long = "loop")]
    pub(crate) repeat: bool,
    /// End after so many seconds of input.
    #[arg(long)]
    pub(crate) seconds: Option<f64>,
    /// Name of this pipeline: two with different names run side by side [default: default].
    #[arg(long)]
    pub(crate) instance: Option<String>,
    /// Configuration file (TOML).
    #[arg(long)]
    pub(crate) config: Option<PathBuf>,
    /// The gate's threshold on the normalised EDS instead of the model's: boxes below it are candidate unknowns (1:
    /// the centre of all prototypes, 2: at a prototype, 0: no unknowns).
    #[arg(long)]
    pub(crate) lambda: Option<f32>,
    /// With a model that has a logit of the unknown (udi-open, kitti-open): probability of being none of the known from which
    /// a box is a candidate unknown, instead of the model's (0: no unknowns). Lower finds more, true and false.
    #[arg(long)]
    pub(crate) unknown_min: Option<f32>,
    /// How the refiner clusters: corrected, literal, distance, dbscan, euclidean, none.
    #[arg(long)]
    pub(crate) refiner_mode: Option<String>,
    /// Follow unknown objects over frames: each gets a number, and is published once two of the last three frames saw
    /// it. Known objects are never delayed.
    #[arg(long)]
    pub(crate) track: bool,
    /// In what the backbone multiplies: f32, bf16 (faster where the processor has it), or int8 (faster still; the model
    /// needs a calibration: mluc-lab quantize) [default: f32].
    #[arg(long)]
    pub(crate) precision: Option<String>,
    /// Frames that leave later than this, ms after their scan, are flagged `late` [default: 200 at pace sensor].
    #[arg(long)]
    pub(crate) budget_ms: Option<u64>,
    /// Check that each payload lies in shared memory, and fail if not (slow).
    #[arg(long)]
    pub(crate) verify_mapping: bool,
    /// Leave a stage to you: start `mluc stage STAGE`, or a program of your own, and replace it while the others run.
    #[arg(long, value_name = "STAGE")]
    pub(crate) without: Vec<String>,
    /// Threads of one stage, STAGE=N [default: backbone=2, others 1].
    #[arg(long = "threads", value_name = "STAGE=N")]
    pub(crate) threads: Vec<String>,
}

#[derive(Args, Clone, Debug)]
pub(crate) struct StageArgs {
    /// ingest, backbone, head or refiner.
    pub(crate) name: String,
    #[command(flatten)]
    pub(crate) pipeline: PipelineArgs,
    /// First frame of the input (set by `up` when it restarts ingest).
    #[arg(long, default_value_t = 0, hide = true)]
    pub(crate) start_sequence: u64,
    /// Process to end with (set by `up`).
    #[arg(long, hide = true)]
    pub(crate) supervised_by: Option<u32>,
}

#[derive(Args, Clone, Debug)]
pub(crate) struct DemoArgs {
    /// Where the picture goes.
    #[arg(long, default_value = "mluc-demo.png")]
    pub(crate) picture: PathBuf,
    /// An embedded model (kitti, kitti-open, udi, udi-open) or a model file.
    #[arg(long, default_value = "udi-open")]
    pub(crate) model: String,
}

#[derive(Args, Clone, Debug)]
pub(crate) struct StatusArgs {
    /// Which pipeline.
    #[arg(long, default_value = "default")]
    pub(crate) instance: String,
    /// One JSON object on stdout.
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Args, Clone, Debug)]
pub(crate) struct DoctorArgs {
    /// The model that shall run.
    #[arg(long, default_value = "kitti")]
    pub(crate) model: String,
}

#[derive(Args, Clone, Debug)]
pub(crate) struct ExecArgs {
    /// Process to end with.
    #[arg(long)]
    pub(crate) supervised_by: u32,
    /// Cores that it may run on.
    #[arg(long, value_delimiter = ',')]
    pub(crate) cpus: Option<Vec<usize>>,
    /// The program and its arguments.
    #[arg(last = true, required = true)]
    pub(crate) command: Vec<String>,
}
