//! Backbone and head over the size of the scan.

use std::path::Path;

use anyhow::Result;
use mluc_backbone::{Backbone, Precision};
use mluc_bench::clock::{Lap, lap_quantile, laps};
use mluc_bench::{inputs, on_threads, save};
use mluc_head::Head;

use crate::{Fit, chart};

const POINTS: [usize; 9] = [
    10_000, 20_000, 40_000, 70_000, 100_000, 131_072, 200_000, 350_000, 500_000,
];
const THREADS: [usize; 2] = [1, 2];
const WARM_UP: usize = 2;

type Size = fn(&Row) -> usize;
type Time = fn(&Lap) -> f64;

/// One size with one number of threads; medians.
#[derive(Clone, Copy, Debug, Default)]
struct Row {
    points: usize,
    threads: usize,
    voxels: usize,
    /// Sites and cells computed, summed over the layers.
    active: usize,
    /// Cells of the bird's-eye map with a feature row.
    cells: usize,
    ms: Lap,
}

/// Measures, writes the table and the pictures; lines through them.
pub(crate) fn run(precision: Precision, rounds: usize, out: &Path) -> Result<Vec<Fit>> {
    let rows = measure(precision, rounds)?;
    let mut csv = String::from("points,threads,voxels,active,cells,wall_ms_p50,cpu_ms_p50\n");
    for row in &rows {
        csv += &format!(
            "{},{},{},{},{},{:.3},{:.3}\n",
            row.points, row.threads, row.voxels, row.active, row.cells, row.ms.wall, row.ms.cpu
        );
    }
    save(out, "network.csv", &csv)?;
    let line = |threads: usize, x: Size, y: Time| -> Vec<(f64, f64)> {
        let rows = rows.iter().filter(|row| row.threads == threads);
        rows.map(|row| (x(row) as f64, y(&row.ms))).collect()
    };
    let title = format!("compact, {precision}: one frame, median");
    let active = "sites and cells computed, all layers";
    let times: [(_, Time); 2] = [("wall time", |l| l.wall), ("CPU time", |l| l.cpu)];
    let [wall, cpu] = times;
    let pictures: [(_, _, Size, _); 3] = [
        ("points.svg", "points", |r| r.points, wall),
        ("active.svg", active, |r| r.active, wall),
        ("active_cpu.svg", active, |r| r.active, cpu),
    ];
    for (name, x_label, x, (what, y)) in pictures {
        let lines = THREADS.map(|threads| {
            let plural = if threads == 1 { "" } else { "s" };
            (format!("{threads} thread{plural}"), line(threads, x, y))
        });
        let labels = [x_label, &format!("{what}, ms")];
        save(out, name, chart::svg(&title, labels, &lines)?)?;
    }
    let fits = THREADS.into_iter().flat_map(|threads| {
        times.map(|(what, y)| {
            let of = format!("network, {threads} thread(s): {what} over sites and cells computed");
            Fit::through(of, &line(threads, |row| row.active, y))
        })
    });
    Ok(fits.collect())
}

fn measure(precision: Precision, rounds: usize) -> Result<Vec<Row>> {
    let (manifest, weights) = inputs::compact();
    let mut rows = vec![];
    for threads in THREADS {
        let mut backbone = Backbone::with_precision(&manifest, &weights, precision)?;
        let mut head = Head::new(&manifest, &weights)?;
        on_threads(threads, || {
            for points in POINTS {
                let scan = inputs::scan_of(points)?;
                let row = one(&mut backbone, &mut head, &scan, rounds)?;
                rows.push(Row { threads, ..row });
            }
            Ok(())
        })?;
    }
    Ok(rows)
}

fn one(backbone: &mut Backbone, head: &mut Head, scan: &[[f32; 4]], rounds: usize) -> Result<Row> {
    let mut row = Row {
        points: scan.len(),
        ..Row::default()
    };
    let frame = backbone.run_in_steps(scan, &mut |step| match step.name {
        "voxels" => row.voxels = step.rows,
        "rulebooks" | "bev" => {}
        _ => row.active += step.rows,
    });
    row.cells = frame.rows;
    let cells_max: usize = backbone.map_shape().iter().product();
    let channels = backbone.feature_channels();
    let (mut cells, mut values) = (vec![0; cells_max], vec![0.0; cells_max * channels]);
    let mut detections = vec![];
    let mut times = vec![];
    let mut lap = laps();
    for _ in 0..WARM_UP + rounds {
        lap();
        let count = backbone.run(scan).rows;
        let (cells, values) = (&mut cells[..count], &mut values[..count * channels]);
        backbone.write_rows(cells, values)?;
        head.run(cells, values, &mut detections)?;
        times.push(lap());
    }
    row.ms = lap_quantile(&times[WARM_UP..], 0.5);
    Ok(row)
}
