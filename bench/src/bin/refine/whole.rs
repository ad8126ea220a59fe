//! Every cluster of whole frames: how many labelled objects are among them, and what it costs.

use std::collections::BTreeMap;

use anyhow::Result;
use mluc_geometry::iou_3d;
use mluc_refiner::{FrameClusterer, FrameClusters, Settings};
use serde::Serialize;

use crate::scene::{self, Frame};
use crate::timing::{PASSES, Timed, percentiles, timed};

/// How well the labelled objects are among the clusters: each with its best one.
#[derive(Default, Serialize)]
struct Found {
    objects: usize,
    mean_iou_3d: f64,
    share_above_0_1: f64,
    share_above_0_3: f64,
    share_above_0_5: f64,
}

#[derive(Serialize)]
struct Report {
    mode: &'static str,
    frames: usize,
    clusters_per_frame: f64,
    #[serde(flatten)]
    all: Found,
    by_class: BTreeMap<String, Found>,
    timed_frames: usize,
    p50_ms: f64,
    p99_ms: f64,
    max_ms: f64,
    cpu_p50_ms: f64,
    cpu_p99_ms: f64,
}

/// Measures and prints.
pub(crate) fn run(frames: &[Frame], settings: &Settings, json: bool) -> Result<()> {
    let mut clusterer = FrameClusterer::new(settings, &scene::sensor())?;
    let mut out = FrameClusters::default();
    let mut times: Vec<Timed> = Vec::new();
    let mut clusters = 0;
    let mut ious: BTreeMap<String, Vec<f64>> = BTreeMap::new();
    for pass in 0..=PASSES {
        for frame in frames {
            let took = timed(|| clusterer.find(&frame.points, &mut out));
            if pass > 0 {
                times.push(took);
                continue;
            }
            clusters += out.clusters.len();
            for object in &frame.objects {
                let overlaps = out.clusters.iter().map(|c| iou_3d(&c.shape, &object.shape));
                let best = overlaps.fold(0.0, f64::max);
                ious.entry(object.class.clone()).or_default().push(best);
            }
        }
    }
    let everyone: Vec<f64> = ious.values().flatten().copied().collect();
    let [p50_ms, p99_ms, max_ms] = percentiles(times.iter().map(|t| t.wall_ms));
    let [cpu_p50_ms, cpu_p99_ms, _] = percentiles(times.iter().map(|t| t.cpu_ms));
    let report = Report {
        mode: "everything",
        frames: frames.len(),
        clusters_per_frame: clusters as f64 / frames.len().max(1) as f64,
        all: found(&everyone),
        by_class: ious
            .iter()
            .map(|(name, own)| (name.clone(), found(own)))
            .collect(),
        timed_frames: times.len(),
        p50_ms,
        p99_ms,
        max_ms,
        cpu_p50_ms,
        cpu_p99_ms,
    };
    if json {
        println!("{}", serde_json::to_string(&report)?);
    } else {
        print(&report);
    }
    Ok(())
}

fn found(ious: &[f64]) -> Found {
    let count = ious.len().max(1) as f64;
    let above = |least: f64| ious.iter().filter(|&&iou| iou > least).count() as f64 / count;
    Found {
        objects: ious.len(),
        mean_iou_3d: ious.iter().sum::<f64>() / count,
        share_above_0_1: above(0.1),
        share_above_0_3: above(0.3),
        share_above_0_5: above(0.5),
    }
}

fn print(report: &Report) {
    println!(
        "every cluster of {} frames, {:.0} a frame",
        report.frames, report.clusters_per_frame
    );
    println!(
        "{:<16} {:>7} {:>9} {:>6} {:>6} {:>6}",
        "class", "objects", "mean IoU", ">0.1", ">0.3", ">0.5"
    );
    let rows = report.by_class.iter().map(|(name, f)| (name.as_str(), f));
    for (name, f) in rows.chain([("all", &report.all)]) {
        println!(
            "{name:<16} {:>7} {:>9.3} {:>6.2} {:>6.2} {:>6.2}",
            f.objects, f.mean_iou_3d, f.share_above_0_1, f.share_above_0_3, f.share_above_0_5
        );
    }
    println!(
        "p50 {:.2} ms, p99 {:.2} ms, max {:.2} ms over {} frames; CPU time p50 {:.2} ms, p99 {:.2} ms",
        report.p50_ms,
        report.p99_ms,
        report.max_ms,
        report.timed_frames,
        report.cpu_p50_ms,
        report.cpu_p99_ms
    );
}
