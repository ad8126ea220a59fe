//! Our clusterers at proposals of simulated scans, and the same points as files for other libraries:
//! `clustering --out FOLDER` (see `bench/peers/clustering`).
//!
//! A candidate is what a clusterer of the refiner gets: the points above the ground within a cylinder around a seed. For
//! each one `NNN.f32` holds x, y, z of its points, `NNN.euclidean.u32` and `NNN.dbscan.u32` the members that we found,
//! and `candidates.json` tells the rest.

use std::path::{Path, PathBuf};

use anyhow::Result;
use clap::Parser;
use mluc_bench::clock::timed_median;
use mluc_bench::machine::describe_here;
use mluc_bench::{inputs, save};
use mluc_geometry::ground::GroundPlane;
use mluc_refiner::paper::grow::{Dbscan, Euclidean, Grower, Growth};
use mluc_refiner::paper::{Gather, Neighbourhood};
use mluc_refiner::{FrameIndex, Settings};
use mluc_simulate::SimulatedFrame;
use serde_json::{Value, json};

/// Of the simulated sensor, m.
const SENSOR_HEIGHT_M: f64 = 1.73;
/// Of the cylinder, m: what the refiner takes where nothing else is set.
const RADIUS_M: f64 = 6.0;
/// Points that a candidate may have; beyond it they are thinned evenly.
const POINTS_MAX: usize = 16_384;
/// Euclidean: points closer than this are joined, m: a usual choice for vehicles.
const TOLERANCE_M: f32 = 0.5;
/// DBSCAN: radius of a neighbourhood, m, and points within it that make a core point.
const EPSILON_M: f32 = 0.6;
const CORE_POINTS: usize = 5;
/// Runs of each clusterer, of which the median counts.
const RUNS: usize = 9;

#[derive(Parser)]
struct Arguments {
    /// Where to.
    #[arg(long)]
    out: PathBuf,
    /// Simulated scans, every labelled object of which is a candidate.
    #[arg(long, default_value_t = 8)]
    frames: u32,
}

fn main() -> Result<()> {
    let arguments = Arguments::parse();
    let mut found = vec![];
    for index in 0..arguments.frames {
        candidates(&inputs::simulated(index)?, &arguments.out, &mut found)?;
    }
    let about = json!({
        "machine": describe_here(),
        "euclidean": { "tolerance_m": TOLERANCE_M },
        "dbscan": { "epsilon_m": EPSILON_M, "core_points": CORE_POINTS },
        "candidates": found,
    });
    save(&arguments.out, "candidates.json", format!("{about:#}\n"))
}

fn candidates(frame: &SimulatedFrame, out: &Path, found: &mut Vec<Value>) -> Result<()> {
    let settings = Settings::default();
    let mut index = FrameIndex::default();
    index.sort(bytemuck::cast_slice(&frame.points));
    let mut around = Neighbourhood::default();
    for object in &frame.objects {
        let center_m = object.box_in_sensor.center_m;
        let center_xy_m = [center_m[0], center_m[1]];
        let ground = GroundPlane::fit(&index.lowest, center_xy_m, SENSOR_HEIGHT_M);
        let off = |at_m: [f32; 3]| -> f64 {
            let off = [0, 1, 2].map(|i| f64::from(at_m[i]) - center_m[i]);
            off.iter().map(|value| value * value).sum()
        };
        let near = index.rows_around(center_xy_m, RADIUS_M).flatten();
        let above = near.filter(|point| {
            let [x, y, z] = point.at_m.map(f64::from);
            z - ground.z_at_m(x, y) >= settings.ground_clearance_m
        });
        let Some(seed) = above.min_by(|a, b| off(a.at_m).total_cmp(&off(b.at_m))) else {
            continue;
        };
        let wanted = Gather {
            radius_m: RADIUS_M,
            height_m: [settings.ground_clearance_m, settings.height_max_m],
            points_max: POINTS_MAX,
        };
        let seed = around.gather(&index, seed, &ground, &wanted);
        found.push(one(&around, seed, out, found.len())?);
    }
    Ok(())
}

fn one(around: &Neighbourhood, seed: usize, out: &Path, number: usize) -> Result<Value> {
    let name = format!("{number:03}");
    let columns = around.x_m.iter().zip(&around.y_m).zip(&around.z_m);
    let values: Vec<f32> = columns.flat_map(|((x, y), z)| [*x, *y, *z]).collect();
    save(out, &format!("{name}.f32"), bytemuck::cast_slice(&values))?;
    let ways: [(&str, Box<dyn Grower>); 2] = [
        ("euclidean", Box::new(Euclidean::new(TOLERANCE_M))),
        ("dbscan", Box::new(Dbscan::new(EPSILON_M, CORE_POINTS))),
    ];
    let growth = Growth {
        around,
        seed,
        height_min_m: f64::NEG_INFINITY,
    };
    let mut ours = serde_json::Map::new();
    for (way, mut grower) in ways {
        let mut members = vec![];
        let us = 1e3 * timed_median(RUNS, || grower.grow(&growth, &mut members)).wall;
        members.sort_unstable();
        let file = format!("{name}.{way}.u32");
        save(out, &file, bytemuck::cast_slice(&members))?;
        let found = json!({ "us": us, "members": members.len() });
        ours.insert(way.into(), found);
    }
    Ok(json!({ "name": name, "points": around.len(), "seed": seed, "ours": ours }))
}
