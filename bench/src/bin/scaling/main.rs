//! Cost over size: the network over 10,000 to 500,000 points with 1 and 2 threads, the refiner over 1 to 512 proposals.
//!
//! Writes CSV and SVG into `docs/results/scaling/`. Scans are simulated, overlaid and thinned to the count; weights by
//! formula. Wall time is what a robot waits for; CPU time is what remains comparable on a machine with other work.

mod fit;
mod network;
mod refiner;

use std::path::PathBuf;

use anyhow::{Context, Result};
use clap::Parser;
use mluc_backbone::Precision;
use mluc_bench::machine::describe_here;

#[derive(Parser)]
struct Arguments {
    /// Where to.
    #[arg(long, default_value = "docs/results/scaling")]
    out: PathBuf,
    /// Timed frames of each size.
    #[arg(long, default_value_t = 15)]
    rounds: usize,
    /// `f32`, `bf16` or `int8`, of the backbone.
    #[arg(long, default_value_t)]
    precision: Precision,
    /// One JSON object on stdout.
    #[arg(long)]
    json: bool,
}

fn main() -> Result<()> {
    let arguments = Arguments::parse();
    std::fs::create_dir_all(&arguments.out).with_context(|| arguments.out.display().to_string())?;
    let network = network::measure(arguments.precision, arguments.rounds)?;
    network::write(&network, arguments.precision, &arguments.out)?;
    let refiner = refiner::measure(arguments.rounds)?;
    refiner::write(&refiner, &arguments.out)?;
    let fits = [network::fits(&network), refiner::fits(&refiner)].concat();
    let summary = serde_json::json!({
        "machine": describe_here(),
        "precision": arguments.precision.to_string(),
        "rounds": arguments.rounds,
        "fits": fits,
    });
    let path = arguments.out.join("summary.json");
    std::fs::write(&path, format!("{summary:#}\n")).with_context(|| path.display().to_string())?;
    if arguments.json {
        println!("{summary}");
    } else {
        for fit in &fits {
            println!("{fit}");
        }
        println!("written to {}", arguments.out.display());
    }
    Ok(())
}
