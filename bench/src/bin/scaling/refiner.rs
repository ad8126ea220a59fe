//! The refiner over the number of proposals, each at an object of the scan.

use std::path::Path;

use anyhow::Result;
use mluc_bench::clock::{Lap, timed_median};
use mluc_bench::{inputs, save};
use mluc_geometry::Box3;
use mluc_ipc_types::Detection;
use mluc_refiner::{Refiner, RefinerOutput, Settings, Study, Variant};

use crate::{Fit, chart};

const PROPOSALS: [usize; 10] = [1, 2, 4, 8, 16, 32, 64, 128, 256, 512];
const VARIANTS: [Variant; 2] = [Variant::PaperCorrected, Variant::RangeScaled];

/// Measures, writes the table and the picture; lines through it.
pub(crate) fn run(rounds: usize, out: &Path) -> Result<Vec<Fit>> {
    let frame = inputs::simulated(0)?;
    let points = bytemuck::cast_slice(&frame.points);
    let objects = frame.objects.iter();
    let boxes: Vec<Box3> = objects.map(|object| object.box_in_sensor).collect();
    let mut csv = String::from("refiner,proposals,wall_ms_p50,cpu_ms_p50\n");
    let mut lines = vec![];
    for variant in VARIANTS {
        let settings = Settings {
            variant,
            // The bound on a frame's work would end the line early.
            study: Study {
                work_max: Some(u64::MAX),
                ..Study::default()
            },
            ..Settings::default()
        };
        let mut refiner = Refiner::new(settings, &inputs::sensor())?;
        let mut refined = RefinerOutput::default();
        let mut line = vec![];
        for proposals in PROPOSALS {
            let detections: Vec<_> = (0..proposals).map(|k| proposal(&boxes, k)).collect();
            let once = || refiner.refine(0, points, &detections, &mut refined);
            let Lap { wall, cpu } = timed_median(rounds, once);
            csv += &format!("{},{proposals},{wall:.4},{cpu:.4}\n", variant.name());
            line.push((proposals as f64, cpu));
        }
        lines.push((variant.name().to_owned(), line));
    }
    save(out, "refiner.csv", &csv)?;
    let labels = ["proposals", "CPU time, ms"];
    let picture = chart::svg("refiner: one frame, median", labels, &lines)?;
    save(out, "proposals.svg", &picture)?;
    let fit = |(name, line): &chart::Line| {
        Fit::through(format!("refiner {name}: CPU time over proposals"), line)
    };
    Ok(lines.iter().map(fit).collect())
}

/// The k-th: objects in turn, each time a little further off, up to 1 m.
fn proposal(boxes: &[Box3], k: usize) -> Detection {
    let found = &boxes[k % boxes.len().max(1)];
    let around = k as f64 * 2.4;
    let off_m = (k as f64 * 0.618).fract();
    let [x, y, z] = found.center_m;
    let shape = Box3 {
        center_m: [x + off_m * around.cos(), y + off_m * around.sin(), z],
        size_m: [1.8, 0.7, 1.6],
        yaw_rad: 0.0,
    };
    inputs::candidate(&shape, 1.0 + k as f32)
}
