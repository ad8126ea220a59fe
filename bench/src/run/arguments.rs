//! The command line, and the table `[bench]` of a scenario: a configuration file of `mluc up`. The command line wins.

use clap::{Args, Parser, Subcommand};
use serde::Deserialize;
use std::path::PathBuf;

/// Latency of the real processes: a report, and the comparison of two.
#[derive(Debug, Parser)]
#[command(name = "mluc-bench", bin_name = "mluc bench", version)]
#[command(args_conflicts_with_subcommands = true)]
pub(crate) struct Cli {
    #[command(subcommand)]
    pub(crate) command: Option<Command>,
    #[command(flatten)]
    pub(crate) run: RunArgs,
}

#[derive(Clone, Debug, Subcommand)]
pub(crate) enum Command {
    /// Compare report B with report A: what differs, and what is noise.
    Compare(CompareArgs),
}

/// What is measured; everything but where the report goes may stand in the scenario instead.
#[derive(Args, Clone, Debug)]
pub(crate) struct RunArgs {
    /// Scenario: a configuration file of `mluc up` with a table [bench] (TOML).
    #[arg(long)]
    pub(crate) scenario: Option<PathBuf>,
    /// Folder of the report; made when missing.
    #[arg(long, default_value = "mluc-bench")]
    pub(crate) out: PathBuf,
    #[command(flatten)]
    pub(crate) bench: BenchTable,
    /// Frames per second [default: 10].
    #[arg(long)]
    pub(crate) rate: Option<f64>,
    /// A folder of scans [default: the bundled simulated ones].
    #[arg(long)]
    pub(crate) input: Option<PathBuf>,
    /// A built-in model (any-open, any) or a model file [default: any-open].
    #[arg(long)]
    pub(crate) model: Option<String>,
    /// auto, f32, bf16 or int8 [default: auto].
    #[arg(long)]
    pub(crate) precision: Option<String>,
    /// The sensor: a product, or a TOML file like those of sensors/.
    #[arg(long, value_name = "NAME|FILE")]
    pub(crate) sensor: Option<String>,
    /// What is published: quiet, balanced or all [default: balanced].
    #[arg(long)]
    pub(crate) profile: Option<String>,
    /// Known objects below this score are not published [default: the profile's].
    #[arg(long)]
    pub(crate) min_score: Option<String>,
    /// Unknown objects below this score are not published [default: the profile's].
    #[arg(long)]
    pub(crate) min_unknown_score: Option<String>,
    /// Threads of one stage, STAGE=N.
    #[arg(long = "threads", value_name = "STAGE=N")]
    pub(crate) threads: Vec<String>,
    /// A refiner's name, or a command in its place ("python3 refiner.py"); twice: both on the same frames, interleaved.
    #[arg(long, value_name = "NAME|COMMAND")]
    pub(crate) refiner: Vec<String>,
    /// Another build's program `mluc`: this build and that one on the same frames, interleaved, each measured by its own
    /// `mluc bench`.
    #[arg(long, value_name = "MLUC")]
    pub(crate) against: Option<PathBuf>,
}

/// How long and how often: options, and `[bench]`.
#[derive(Args, Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct BenchTable {
    /// How long to measure, s, after the warm-up [default: 20].
    #[arg(long)]
    pub(crate) seconds: Option<f64>,
    /// Warm-up: frames that are due in the first SECONDS count in no figure [default: 2].
    #[arg(long = "warm-up", value_name = "SECONDS")]
    pub(crate) warm_up_seconds: Option<f64>,
    /// Starts of the processes over which the seconds are spread [default: 1; 4 when two things are compared].
    #[arg(long)]
    pub(crate) rounds: Option<u32>,
    /// Longest wait for objects, s; after it the measurement fails [default: 60].
    #[arg(long = "patience", value_name = "SECONDS")]
    pub(crate) patience_seconds: Option<f64>,
}

impl RunArgs {
    /// Whether two things are measured and compared.
    pub(crate) fn compares(&self) -> bool {
        self.refiner.len() > 1 || self.against.is_some()
    }
}

impl BenchTable {
    /// These options; the table's value where an option is not given.
    pub(crate) fn over(&self, table: BenchTable) -> BenchTable {
        BenchTable {
            seconds: self.seconds.or(table.seconds),
            warm_up_seconds: self.warm_up_seconds.or(table.warm_up_seconds),
            rounds: self.rounds.or(table.rounds),
            patience_seconds: self.patience_seconds.or(table.patience_seconds),
        }
    }
}

#[derive(Args, Clone, Debug)]
pub(crate) struct CompareArgs {
    /// Folder of the first report.
    pub(crate) a: PathBuf,
    /// Folder of the second one.
    pub(crate) b: PathBuf,
    /// One JSON object on stdout.
    #[arg(long)]
    pub(crate) json: bool,
}
