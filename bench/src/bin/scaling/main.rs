//! Cost over size: the network over 10,000 to 500,000 points with 1 and 2 threads, the refiner over 1 to 512 proposals.
//!
//! Writes CSV and SVG into `docs/results/scaling/`. Scans are simulated, overlaid and thinned to the count; weights by
//! formula. Wall time is what a robot waits for; CPU time is what remains comparable on a machine with other work.

mod chart;
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
    let out = Folder(arguments.out);
    std::fs::create_dir_all(&out.0).with_context(|| out.0.display().to_string())?;
    let network = network::run(arguments.precision, arguments.rounds, &out)?;
    let refiner = refiner::run(arguments.rounds, &out)?;
    let fits = [network, refiner].concat();
    let summary = serde_json::json!({
        "machine": describe_here(),
        "precision": arguments.precision.to_string(),
        "rounds": arguments.rounds,
        "fits": fits,
    });
    out.save("summary.json", &format!("{summary:#}\n"))?;
    if arguments.json {
        println!("{summary}");
    } else {
        for fit in &fits {
            println!("{fit}");
        }
        println!("written to {}", out.0.display());
    }
    Ok(())
}

/// Where the results go.
struct Folder(PathBuf);

impl Folder {
    fn save(&self, name: &str, text: &str) -> Result<()> {
        let path = self.0.join(name);
        std::fs::write(&path, text).with_context(|| path.display().to_string())
    }
}
