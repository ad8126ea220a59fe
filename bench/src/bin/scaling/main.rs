//! Cost over size: the network over 10,000 to 500,000 points with 1 and 2 threads, the refiner over 1 to 512 proposals.
//!
//! Writes CSV and SVG into `docs/results/scaling/`. Scans are simulated, overlaid and thinned to the count; weights by
//! formula. Wall time is what a robot waits for; CPU time is what remains comparable on a machine with other work.

mod chart;
mod network;
mod refiner;

use std::path::PathBuf;

use anyhow::Result;
use clap::Parser;
use mluc_backbone::Precision;
use mluc_bench::machine::describe_here;
use mluc_bench::save;
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
    let out = &arguments.out;
    let network = network::run(arguments.precision, arguments.rounds, out)?;
    let refiner = refiner::run(arguments.rounds, out)?;
    let fits = [network, refiner].concat();
    let summary = serde_json::json!({
        "machine": describe_here(),
        "precision": arguments.precision.to_string(),
        "rounds": arguments.rounds,
        "fits": fits,
    });
    save(out, "summary.json", format!("{summary:#}\n"))?;
    if arguments.json {
        println!("{summary}");
    } else {
        for fit in &fits {
            println!("{fit}");
        }
        println!("written to {}", out.display());
    }
    Ok(())
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
        let mean = |of: &dyn Fn(f64, f64) -> f64| {
            let sum: f64 = points.iter().map(|(x, y)| of(*x, *y)).sum();
            sum / points.len().max(1) as f64
        };
        let (x_mean, y_mean) = (mean(&|x, _| x), mean(&|_, y| y));
        let xx = mean(&|x, _| (x - x_mean).powi(2));
        let yy = mean(&|_, y| (y - y_mean).powi(2));
        let xy = mean(&|x, y| (x - x_mean) * (y - y_mean));
        let slope = if xx > 0.0 { xy / xx } else { 0.0 };
        let is_spread = xx * yy > 0.0;
        Fit {
            of,
            at_zero_ms: y_mean - slope * x_mean,
            us_each: 1e3 * slope,
            r_squared: if is_spread { xy * xy / (xx * yy) } else { 1.0 },
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
