//! The refiner over the number of proposals, each at an object of the scan.

use std::path::Path;

use anyhow::Result;
use mluc_bench::chart::{Chart, Series};
use mluc_bench::inputs;
use mluc_geometry::Box3;
use mluc_ipc_types::{Detection, DetectionKind};
use mluc_refiner::{Mode, Refined, Refiner, Settings};

use crate::clock::{Times, median, timed};
use crate::fit::Fit;
use crate::network::save;

const PROPOSALS: [usize; 10] = [1, 2, 4, 8, 16, 32, 64, 128, 256, 512];
const MODES: [Mode; 4] = [
    Mode::Corrected,
    Mode::Distance,
    Mode::Euclidean,
    Mode::Dbscan,
];

/// One number of proposals with one way to cluster; medians.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Row {
    mode: Mode,
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
    for mode in MODES {
        let settings = Settings {
            mode,
            // The bound on a frame's work would end the line early.
            work_max: u64::MAX,
            ..Settings::default()
        };
        let mut refiner = Refiner::new(settings, &inputs::sensor())?;
        let mut refined = Refined::default();
        for proposals in PROPOSALS {
            let detections: Vec<_> = (0..proposals).map(|k| proposal(&boxes, k)).collect();
            let times: Vec<Times> = (0..=rounds)
                .map(|round| {
                    timed(|| refiner.refine(round as u64, &points, &detections, &mut refined))
                })
                .skip(1)
                .collect();
            rows.push(Row {
                mode,
                proposals,
                wall_ms: median(times.iter().map(|times| times.wall_ms).collect()),
                cpu_ms: median(times.iter().map(|times| times.cpu_ms).collect()),
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
            row.mode.name(),
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
        series: MODES
            .iter()
            .map(|&mode| Series {
                name: mode.name().into(),
                points: of(rows, mode),
                is_line: true,
            })
            .collect(),
    };
    save(out, "proposals.svg", &chart.svg())
}

pub(crate) fn fits(rows: &[Row]) -> Vec<Fit> {
    let fit = |mode: Mode| {
        let name = format!("refiner {}: CPU time over proposals", mode.name());
        Fit::through(name, &of(rows, mode))
    };
    MODES.into_iter().map(fit).collect()
}

fn of(rows: &[Row], mode: Mode) -> Vec<[f64; 2]> {
    let own = rows.iter().filter(|row| row.mode == mode);
    own.map(|row| [row.proposals as f64, row.cpu_ms]).collect()
}
