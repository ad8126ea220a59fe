//! The refiner over the number of proposals, each at an object of the scan.

use std::path::Path;

use anyhow::Result;
use mluc_bench::chart::{Chart, Series};
use mluc_bench::clock::{Lap, laps};
use mluc_bench::inputs;
use mluc_geometry::{Box3, quantile_of};
use mluc_ipc_types::{Detection, DetectionKind};
use mluc_refiner::{Refiner, RefinerOutput, Settings, Study, Variant};

use crate::fit::Fit;
use crate::network::save;

const PROPOSALS: [usize; 10] = [1, 2, 4, 8, 16, 32, 64, 128, 256, 512];
const VARIANTS: [Variant; 2] = [Variant::PaperCorrected, Variant::RangeScaled];

/// One number of proposals with one way to cluster; medians.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Row {
    variant: Variant,
    proposals: usize,
    wall_ms: f64,
    cpu_ms: f64,
}

pub(crate) fn measure(rounds: usize) -> Result<Vec<Row>> {
    let frame = inputs::simulated(0)?;
    let points = inputs::as_points(&frame.points);
    let boxes: Vec<Box3> = frame
        .objects
        .iter()
        .map(|object| object.box_in_sensor)
        .collect();
    let mut rows = vec![];
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
        for proposals in PROPOSALS {
            let detections: Vec<_> = (0..proposals).map(|k| proposal(&boxes, k)).collect();
            let mut lap = laps();
            let mut once = |round: usize| {
                lap();
                refiner.refine(round as u64, &points, &detections, &mut refined);
                lap()
            };
            let times: Vec<Lap> = (0..=rounds).map(&mut once).skip(1).collect();
            let median = |of: fn(&Lap) -> f64| {
                quantile_of(times.iter().map(of).collect(), 0.5).unwrap_or_default()
            };
            rows.push(Row {
                variant,
                proposals,
                wall_ms: median(|times| times.wall),
                cpu_ms: median(|times| times.cpu),
            });
        }
    }
    Ok(rows)
}

/// The k-th: objects in turn, each time a little further off, up to 1 m.
fn proposal(boxes: &[Box3], k: usize) -> Detection {
    let found = &boxes[k % boxes.len().max(1)];
    let around = k as f64 * 2.4;
    let off_m = (k as f64 * 0.618).fract();
    let shift = [off_m * around.cos(), off_m * around.sin(), 0.0];
    Detection {
        center_m: [0, 1, 2].map(|i| (found.center_m[i] + shift[i]) as f32),
        size_m: [1.8, 0.7, 1.6],
        kind: DetectionKind::Candidate as u32,
        objectness: 0.5,
        score: 0.3,
        eds: 1.0 + k as f32,
        ..Detection::default()
    }
}

pub(crate) fn write(rows: &[Row], out: &Path) -> Result<()> {
    let mut csv = String::from("refiner,proposals,wall_ms_p50,cpu_ms_p50\n");
    for row in rows {
        csv += &format!(
            "{},{},{:.4},{:.4}\n",
            row.variant.name(),
            row.proposals,
            row.wall_ms,
            row.cpu_ms
        );
    }
    save(out, "refiner.csv", &csv)?;
    let chart = Chart {
        title: "refiner: one frame, median".into(),
        x_label: "proposals".into(),
        y_label: "CPU time, ms".into(),
        series: VARIANTS
            .iter()
            .map(|&variant| Series {
                name: variant.name().into(),
                points: of(rows, variant),
            })
            .collect(),
    };
    save(out, "proposals.svg", &chart.svg())
}

pub(crate) fn fits(rows: &[Row]) -> Vec<Fit> {
    let fit = |variant: Variant| {
        let name = format!("refiner {}: CPU time over proposals", variant.name());
        Fit::through(name, &of(rows, variant))
    };
    VARIANTS.into_iter().map(fit).collect()
}

fn of(rows: &[Row], variant: Variant) -> Vec<[f64; 2]> {
    let own = rows.iter().filter(|row| row.variant == variant);
    own.map(|row| [row.proposals as f64, row.cpu_ms]).collect()
}
