//! Cost over size: the network over 10,000 to 500,000 points with 1 and 2 threads, the refiner over 1 to 512 proposals.
//!
//! Writes CSV and SVG into `docs/results/scaling/`. Scans are simulated, overlaid and thinned to the count; weights by
//! formula. Wall time is what a robot waits for; CPU time is what remains comparable on a machine with other work.

mod chart;
mod network;
mod refiner;

use std::path::PathBuf;

use anyhow::{Context, Result};
use clap::Parser;
use mluc_backbone::Precision;
use mluc_bench::machine::describe_here;
use serde::Serialize;

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

/// How well a straight line describes cost over size: cost = at_zero + slope * size, by least squares.
#[derive(Clone, Debug, Serialize)]
struct Fit {
    /// What against what.
    of: String,
    /// ms.
    at_zero_ms: f64,
    /// us for one more.
    us_each: f64,
    /// Share of the costs' variance that the line explains: 1 is a perfect line.
    r_squared: f64,
}

impl Fit {
    /// `points`: size and cost in ms.
    fn through(of: String, points: &[(f64, f64)]) -> Fit {
        let count = points.len().max(1) as f64;
        let x_mean = points.iter().map(|(x, _)| x).sum::<f64>() / count;
        let y_mean = points.iter().map(|(_, y)| y).sum::<f64>() / count;
        let off = points.iter().map(|(x, y)| (x - x_mean, y - y_mean));
        let [xx, xy, yy] = off.fold([0.0; 3], |[xx, xy, yy], (x, y)| {
            [xx + x * x, xy + x * y, yy + y * y]
        });
        let slope = if xx > 0.0 { xy / xx } else { 0.0 };
        Fit {
            of,
            at_zero_ms: y_mean - slope * x_mean,
            us_each: 1e3 * slope,
            r_squared: if xx * yy > 0.0 {
                xy * xy / (xx * yy)
            } else {
                1.0
            },
        }
    }
}

impl std::fmt::Display for Fit {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "{}: {:.2} ms + {:.3} us each, R^2 {:.4}",
            self.of, self.at_zero_ms, self.us_each, self.r_squared
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_found_and_a_bend_is_told() {
        let line: Vec<_> = (0..10).map(|x| (x as f64, 3.0 + 0.5 * x as f64)).collect();
        let fit = Fit::through("line".into(), &line);
        assert!((fit.at_zero_ms - 3.0).abs() < 1e-9 && (fit.us_each - 500.0).abs() < 1e-6);
        assert!((fit.r_squared - 1.0).abs() < 1e-9);
        let bend: Vec<_> = (0..10).map(|x| (x as f64, (x * x * x) as f64)).collect();
        assert!(Fit::through("bend".into(), &bend).r_squared < 0.9);
        assert_eq!(Fit::through("nothing".into(), &[]).us_each, 0.0);
    }
}
