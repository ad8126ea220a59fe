//! Backbone and head over the size of the scan.

use std::path::Path;

use anyhow::{Context, Result};
use mluc_backbone::{Backbone, Precision};
use mluc_bench::chart::{Chart, Series};
use mluc_bench::clock::{Lap, laps};
use mluc_bench::inputs;
use mluc_geometry::quantile_of;
use mluc_head::Head;

use crate::fit::Fit;

const POINTS: [usize; 9] = [
    10_000, 20_000, 40_000, 70_000, 100_000, 131_072, 200_000, 350_000, 500_000,
];
const THREADS: [usize; 2] = [1, 2];
const WARM_UP: usize = 2;

/// One size with one number of threads; medians.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Row {
    points: usize,
    threads: usize,
    voxels: usize,
    /// Sites and cells computed, summed over the layers.
    active: usize,
    /// Cells of the bird's-eye map with a feature row.
    cells: usize,
    wall_ms: f64,
    cpu_ms: f64,
}

pub(crate) fn measure(precision: Precision, rounds: usize) -> Result<Vec<Row>> {
    let (manifest, weights) = inputs::compact();
    let mut rows = vec![];
    for threads in THREADS {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()?;
        let mut backbone = Backbone::with_precision(&manifest, &weights, precision)?;
        let mut head = Head::new(&manifest, &weights)?;
        for points in POINTS {
            let scan = inputs::scan_of(points)?;
            let row = pool.install(|| one_size(&mut backbone, &mut head, &scan, rounds))?;
            rows.push(Row { threads, ..row });
        }
    }
    Ok(rows)
}

fn one_size(
    backbone: &mut Backbone,
    head: &mut Head,
    scan: &[[f32; 4]],
    rounds: usize,
) -> Result<Row> {
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
    let mut times: Vec<Lap> = vec![];
    let mut lap = laps();
    for _ in 0..WARM_UP + rounds {
        lap();
        let count = backbone.run(scan).rows;
        let (cells, values) = (&mut cells[..count], &mut values[..count * channels]);
        backbone.write_rows(cells, values)?;
        head.run(cells, values, &mut detections)?;
        times.push(lap());
    }
    let median = |of: fn(&Lap) -> f64| {
        let values = times.iter().skip(WARM_UP).map(of).collect();
        quantile_of(values, 0.5).unwrap_or_default()
    };
    row.wall_ms = median(|times| times.wall);
    row.cpu_ms = median(|times| times.cpu);
    Ok(row)
}

pub(crate) fn write(rows: &[Row], precision: Precision, out: &Path) -> Result<()> {
    let mut csv = String::from("points,threads,voxels,active,cells,wall_ms_p50,cpu_ms_p50\n");
    for row in rows {
        csv += &format!(
            "{},{},{},{},{},{:.3},{:.3}\n",
            row.points, row.threads, row.voxels, row.active, row.cells, row.wall_ms, row.cpu_ms
        );
    }
    save(out, "network.csv", &csv)?;
    let chart = |x_label: &str, x: fn(&Row) -> usize, y_label: &str, y: fn(&Row) -> f64| Chart {
        title: format!("compact, {precision}: one frame, median"),
        x_label: x_label.into(),
        y_label: y_label.into(),
        series: THREADS
            .iter()
            .map(|&threads| Series {
                name: match threads {
                    1 => "1 thread".into(),
                    _ => format!("{threads} threads"),
                },
                points: of(rows, threads)
                    .map(|row| [x(row) as f64, y(row)])
                    .collect(),
            })
            .collect(),
    };
    let active = "sites and cells computed, all layers";
    save(
        out,
        "points.svg",
        &chart(
            "points",
            |row| row.points,
            "wall time, ms",
            |row| row.wall_ms,
        )
        .svg(),
    )?;
    save(
        out,
        "active.svg",
        &chart(active, |row| row.active, "wall time, ms", |row| row.wall_ms).svg(),
    )?;
    save(
        out,
        "active_cpu.svg",
        &chart(active, |row| row.active, "CPU time, ms", |row| row.cpu_ms).svg(),
    )
}

pub(crate) fn fits(rows: &[Row]) -> Vec<Fit> {
    let fit = |threads: usize, what: &str, y: fn(&Row) -> f64| {
        let points: Vec<_> = of(rows, threads)
            .map(|row| [row.active as f64, y(row)])
            .collect();
        let of = format!("network, {threads} thread(s): {what} over sites and cells computed");
        Fit::through(of, &points)
    };
    THREADS
        .into_iter()
        .flat_map(|threads| {
            [
                fit(threads, "wall time", |row| row.wall_ms),
                fit(threads, "CPU time", |row| row.cpu_ms),
            ]
        })
        .collect()
}

fn of(rows: &[Row], threads: usize) -> impl Iterator<Item = &Row> {
    rows.iter().filter(move |row| row.threads == threads)
}

pub(crate) fn save(out: &Path, name: &str, text: &str) -> Result<()> {
    let path = out.join(name);
    std::fs::write(&path, text).with_context(|| path.display().to_string())
}
