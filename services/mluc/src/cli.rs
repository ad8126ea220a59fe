//! The command line.

use crate::settings::{DEFAULT_MODEL, Pace, Profile};
use crate::{commands::loopback, external::ExternalArgs};
use clap::{Args, Parser, Subcommand};
use mluc_ipc_types::Stage;
use mluc_refiner::Variant;
use mluc_runtime::LOG_FORMATS;
use mluc_sources::{INPUT, LayoutArgs};
use serde::Serialize;
use std::{net::SocketAddr, path::PathBuf};

/// Known and unknown objects in LiDAR scans.
#[derive(Debug, Parser)]
#[command(name = "mluc", version)]
pub(crate) struct Cli {
    #[command(subcommand)]
    pub(crate) command: Command,
    /// How the log on stderr is written [default: MLUC_LOG_FORMAT, else human].
    #[arg(long, global = true, value_parser = LOG_FORMATS)]
    pub(crate) log_format: Option<String>,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Run the pipeline on scans; writes one JSON line per frame to stdout.
    Up(PipelineArgs),
    /// Run the pipeline on your scans, or on bundled simulated ones: objects, latency table, a picture of one frame.
    Demo {
        /// File of the picture (PNG).
        #[arg(long, default_value = "mluc-demo.png")]
        picture: PathBuf,
        #[command(flatten)]
        pipeline: PipelineArgs,
    },
    /// Run the pipeline on a recording of `mluc record`, every scan of it, and compare its objects with the recorded ones; a JSON line on
    /// stdout for each scan where they differ. Exit code 1: objects differ, a frame was lost, or no frame could be compared.
    Replay {
        /// Begin at this stage, with what `mluc record --stages` wrote of the one before it: head, refiner [default: backbone, with the points].
        #[arg(long, value_name = "STAGE", value_parser = later_stage)]
        from: Option<Stage>,
        #[command(flatten)]
        pipeline: PipelineArgs,
    },
    /// Run one stage in this process (`up` starts them by itself). Options under `Input` concern ingest alone.
    Stage(StageArgs),
    /// Check the settings of `up` without a run; with --print, show them and where each comes from.
    Config {
        /// Show the resolved settings: a configuration file with the same effect.
        #[arg(long)]
        print: bool,
        #[command(flatten)]
        pipeline: PipelineArgs,
    },
    /// Show the state of each stage of a running pipeline.
    Status {
        /// Name of the pipeline [default: MLUC_INSTANCE, else `default`].
        #[arg(long)]
        instance: Option<String>,
        /// One JSON object on stdout.
        #[arg(long)]
        json: bool,
    },
    /// Show the state of a running pipeline once a second: rates, latency by stage, dropped frames, warnings.
    Top {
        /// Name of the pipeline [default: MLUC_INSTANCE, else `default`].
        #[arg(long)]
        instance: Option<String>,
        /// Print one page, after about 1.4 s, and end.
        #[arg(long)]
        once: bool,
    },
    /// Serve the state of a running pipeline over HTTP: /healthz, /readyz, /metrics (Prometheus), /status.json.
    Monitor {
        /// Name of the pipeline, which may be started later [default: MLUC_INSTANCE, else `default`].
        #[arg(long)]
        instance: Option<String>,
        /// 127.0.0.1:PORT or [::1]:PORT.
        #[arg(long, value_parser = loopback)]
        listen: SocketAddr,
    },
    /// Have a running pipeline read its configuration file again: thresholds, operating profile and model.
    Reload {
        /// Name of the pipeline [default: MLUC_INSTANCE, else `default`].
        #[arg(long)]
        instance: Option<String>,
    },
    /// Show points and objects of a running pipeline in a browser. Needs the program mluc-view.
    View(ExternalArgs),
    /// Write points and objects of a running pipeline to an MCAP file. Needs the program mluc-view.
    Record(ExternalArgs),
    /// Publish points and objects of a running pipeline as ROS 2 topics. Needs the program mluc-ros2.
    Publish(ExternalArgs),
    /// Publish objects and states of a running pipeline to other computers, over zenoh. Needs the program mluc-zenoh.
    Zenoh(ExternalArgs),
    /// Check whether this machine can run the pipeline.
    Doctor(DoctorArgs),
    /// Measure latency, stage by stage, and write a report; `bench compare` compares two. Needs the program mluc-bench.
    Bench(ExternalArgs),
    /// Test any program against the refiner's contract (docs/CONTRACT.md); needs the program mluc-contract.
    RefinerTest(ExternalArgs),
    /// Remove what killed processes left in an instance whose other processes are alive (used by `up`).
    #[command(hide = true)]
    Clean {
        #[arg(long)]
        instance: String,
    },
    /// Start a program that ends with its parent (used by `up` for foreign stages).
    #[command(hide = true)]
    Exec {
        /// Process to end with.
        #[arg(long)]
        supervised_by: u32,
        /// Cores that it may run on.
        #[arg(long, value_delimiter = ',')]
        cpus: Option<Vec<usize>>,
        /// The program and its arguments.
        #[arg(last = true, required = true)]
        command: Vec<String>,
    },
}

/// A heading of the help: what concerns head and refiner.
const OBJECTS: &str = "Objects";

/// What `up`, `stage` and `config` share; everything may stand in the configuration file instead (docs/configuration.md).
/// Serialized, it holds the given options except --sensor, --config, --refiner-variant, --without and --threads.
#[derive(Args, Clone, Debug, Default, Serialize)]
pub(crate) struct PipelineArgs {
    /// A folder of scans (or of `velodyne/`) or one scan (.bin, .pcd.bin, .npy, .pcd, .ply, .las), a capture (.pcap, .pcapng), a recording
    /// (.mcap), one of these on standard input (-), a live sensor (udp:2368, udp:ADDRESS:PORT), a folder that grows (follow:DIR), or a ROS 2 topic (ros2:/TOPIC; needs the program mluc-ros2).
    #[arg(long, help_heading = INPUT)]
    pub(crate) input: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) layout: LayoutArgs,
    /// A built-in model (any-open, any) or a model file [default: any-open].
    #[arg(long)]
    pub(crate) model: Option<String>,
    /// The sensor: a product (vlp-16, for instance) or a TOML file like those of sensors/. Scans that contradict it are flagged.
    #[arg(long, value_name = "NAME|FILE", help_heading = INPUT)]
    #[serde(skip)]
    pub(crate) sensor: Option<String>,
    /// When the next frame enters [default: sensor; `demo` with files: complete; `replay`: always complete].
    #[arg(long, value_enum)]
    pub(crate) pace: Option<Pace>,
    /// Frames per second at pace `sensor` [default: the input's own times, else 10].
    #[arg(long, help_heading = INPUT)]
    #[serde(rename = "rate_hz")]
    pub(crate) rate: Option<f64>,
    /// Begin again after the last scan.
    #[arg(long = "loop", help_heading = INPUT)]
    #[serde(rename = "loop", skip_serializing_if = "std::ops::Not::not")]
    pub(crate) repeat: bool,
    /// End this many seconds after all stages are ready, by the clock.
    #[arg(long, help_heading = INPUT)]
    pub(crate) seconds: Option<f64>,
    /// Name of this pipeline: pipelines with different names can run at the same time [default: MLUC_INSTANCE, else `default`; `demo`, `replay`: a name of their own].
    #[arg(long)]
    pub(crate) instance: Option<String>,
    /// Configuration file (TOML).
    #[arg(long)]
    #[serde(skip)]
    pub(crate) config: Option<PathBuf>,
    /// With a model whose gate is the EDS (the paper's head): threshold on the normalised EDS instead of the model's. Boxes below
    /// it are candidate unknowns (1: the centre of all prototypes, 2: at a prototype, 0: no unknowns).
    #[arg(long, help_heading = OBJECTS)]
    pub(crate) lambda: Option<f64>,
    /// With a model that has a logit of the unknown (an -open model): probability of being none of the known from which
    /// a box is a candidate unknown, instead of the model's (0: no unknowns). Lower finds more, true and false;
    /// below one half, only boxes with a class.
    #[arg(long, help_heading = OBJECTS)]
    pub(crate) unknown_min: Option<f64>,
    /// What is published; the rest stays in the lines as `low_score` [default: balanced].
    #[arg(long, value_enum, help_heading = OBJECTS)]
    pub(crate) profile: Option<Profile>,
    /// Known objects below this score are not published [default: the profile's].
    #[arg(long, help_heading = OBJECTS)]
    pub(crate) min_score: Option<f64>,
    /// Unknown objects below this score are not published [default: the profile's].
    #[arg(long, help_heading = OBJECTS)]
    pub(crate) min_unknown_score: Option<f64>,
    /// How the points of an unknown object are found; none: it keeps the box of the proposal [default: range-scaled].
    #[arg(long, value_parser = Variant::ALL.map(Variant::name), help_heading = OBJECTS)]
    #[serde(skip)]
    pub(crate) refiner_variant: Option<String>,
    /// Track unknown objects over frames: one is published when enough of the last frames show it and its track is likely enough ([track]); its score no
    /// longer decides. Known objects are never delayed.
    #[arg(long, help_heading = OBJECTS)]
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub(crate) track: bool,
    /// Arithmetic of the backbone: f32, bf16, int8 (the model needs a calibration: mluc-lab quantize), or auto, the fastest on this
    /// processor of those that cost at most 0.5 points of mAP known and 1.0 of AP unknown on the validation split [default: auto].
    #[arg(long, value_parser = ["auto", "f32", "bf16", "int8"], hide_possible_values = true)]
    pub(crate) precision: Option<String>,
    /// Frames that leave later than this, ms after their scan, are flagged `late` [default: 200 at pace sensor].
    #[arg(long)]
    pub(crate) budget_ms: Option<u64>,
    /// Also write a line to stdout when the pipeline's state, its reason, blind_deg or ground_lost changes.
    #[arg(long)]
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub(crate) status_lines: bool,
    /// Check that each payload lies in shared memory, and fail if not (slow).
    #[arg(long)]
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub(crate) verify_mapping: bool,
    /// Do not start this stage: you start it (`mluc stage STAGE`, or your own program), and may replace it while the others run.
    #[arg(long, value_name = "STAGE", value_parser = Stage::ALL.map(Stage::name))]
    #[serde(skip)]
    pub(crate) without: Vec<String>,
    /// Threads of one stage, STAGE=N [default: backbone and head 2, others 1].
    #[arg(long, value_name = "STAGE=N", value_parser = stage_threads)]
    #[serde(skip)]
    pub(crate) threads: Vec<(Stage, u16)>,
}

fn later_stage(word: &str) -> Result<Stage, String> {
    let stage = Stage::from_name(word).filter(|stage| *stage > Stage::Backbone);
    stage.ok_or_else(|| "expected head or refiner".to_string())
}

fn stage_threads(word: &str) -> Result<(Stage, u16), String> {
    let pair = word
        .split_once('=')
        .and_then(|(name, count)| Some((Stage::from_name(name)?, count.parse().ok()?)));
    pair.ok_or_else(|| {
        let stages = Stage::ALL.map(Stage::name).join(", ");
        format!("expected STAGE=N, backbone=2 for instance; the stages are {stages}")
    })
}

/// The command line of one stage's process.
#[derive(Args, Clone, Debug)]
pub struct StageArgs {
    /// The stage.
    #[arg(value_parser = Stage::ALL.map(Stage::name))]
    pub(crate) name: String,
    #[command(flatten)]
    pub(crate) pipeline: PipelineArgs,
    /// First frame that is still to come (set by `up` when it restarts a stage).
    #[arg(long, default_value_t = 0, hide = true)]
    pub(crate) start_sequence: u64,
    /// Process to end with (set by `up`).
    #[arg(long, hide = true)]
    pub(crate) supervised_by: Option<u32>,
    /// Compute nothing: the recording that is the input has what goes to this stage (set by `replay --from`).
    #[arg(long, hide = true, value_parser = later_stage)]
    pub(crate) played_to: Option<Stage>,
}

/// What `mluc doctor` is asked to look at.
#[derive(Args, Clone, Debug)]
pub struct DoctorArgs {
    /// The model to check.
    #[arg(long, default_value = DEFAULT_MODEL)]
    pub(crate) model: String,
    /// Also check these scans: which sensor they come from, and whether the model takes them.
    #[arg(long)]
    pub(crate) input: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) layout: LayoutArgs,
    /// The sensor that the scans of --input should come from: a product or a TOML file. No effect without --input.
    #[arg(long, value_name = "NAME|FILE")]
    pub(crate) sensor: Option<String>,
}
