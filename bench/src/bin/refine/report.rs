//! The figures of one refiner on one folder.

use std::collections::BTreeMap;

use anyhow::Result;
use mluc_refiner::Settings;
use serde::Serialize;

use crate::quality::{Judged, Quality, judge, quality};
use crate::scene::Frame;
use crate::timing::{percentiles, time};

/// What `--json` prints.
#[derive(Serialize)]
pub(crate) struct Report {
    refiner: &'static str,
    frames: usize,
    #[serde(flatten)]
    all: Quality,
    by_class: BTreeMap<String, Quality>,
    proposals: usize,
    timed_frames: usize,
    p50_ms: f64,
    p99_ms: f64,
    max_ms: f64,
    cpu_p50_ms: f64,
    cpu_p99_ms: f64,
    work_p50: f64,
    work_max: f64,
}

/// Quality, then time.
pub(crate) fn measure(
    frames: &[Frame],
    settings: Settings,
    proposals: usize,
    anywhere: bool,
) -> Result<Report> {
    let variant = settings.variant;
    let mut refiner = crate::refiner(settings)?;
    let judged = judge(frames, &mut refiner);
    let times = time(frames, &mut refiner, proposals, anywhere);
    let [p50_ms, p99_ms, max_ms] = percentiles(times.iter().map(|t| t.wall_ms));
    let [cpu_p50_ms, cpu_p99_ms, _] = percentiles(times.iter().map(|t| t.cpu_ms));
    let [work_p50, _, work_max] = percentiles(times.iter().map(|t| t.work as f64));
    Ok(Report {
        refiner: variant.name(),
        frames: frames.len(),
        all: quality(&judged.iter().collect::<Vec<_>>()),
        by_class: by_class(&judged),
        proposals,
        timed_frames: times.len(),
        p50_ms,
        p99_ms,
        max_ms,
        cpu_p50_ms,
        cpu_p99_ms,
        work_p50,
        work_max,
    })
}

fn by_class(judged: &[Judged]) -> BTreeMap<String, Quality> {
    let mut classes: BTreeMap<String, Vec<&Judged>> = BTreeMap::new();
    for object in judged {
        classes
            .entry(object.class.clone())
            .or_default()
            .push(object);
    }
    let rows = classes.into_iter();
    rows.map(|(class, objects)| (class, quality(&objects)))
        .collect()
}

/// A line for each object.
pub(crate) fn list(frames: &[Frame], settings: Settings) -> Result<()> {
    let mut refiner = crate::refiner(settings)?;
    let judged = judge(frames, &mut refiner);
    let objects = frames
        .iter()
        .flat_map(|f| f.objects.iter().map(|o| (f.number, &o.shape)));
    println!(
        "frame class IoU of the first, mean, ceiling | label: place, size, heading | found: disposition, place, size, heading, points"
    );
    for ((frame, label), own) in objects.zip(&judged) {
        let mean = own.ious.iter().sum::<f64>() / own.ious.len().max(1) as f64;
        let first = own.ious.first().copied().unwrap_or(0.0);
        print!(
            "{frame:>4} {:<10} {first:.2} {mean:.2} {:.2} |",
            own.class, own.ceiling
        );
        print!(
            " {:6.1?} {:.1?} {:.1} |",
            label.center_m, label.size_m, label.yaw_rad
        );
        match own.first {
            Some(o) => println!(
                " {} {:6.1?} {:.1?} {:.1} {}",
                o.disposition, o.center_m, o.size_m, o.yaw_rad, o.points_count
            ),
            None => println!(" nothing"),
        }
    }
    Ok(())
}

impl Report {
    /// As a table.
    pub(crate) fn print(&self) {
        println!("refiner {}, {} frames", self.refiner, self.frames);
        println!(
            "{:<16} {:>7} {:>9} {:>6} {:>6} {:>6} {:>8}",
            "class", "objects", "mean IoU", ">0.1", ">0.3", ">0.5", "ceiling"
        );
        let rows = self.by_class.iter().map(|(name, q)| (name.as_str(), q));
        for (name, q) in rows.chain([("all", &self.all)]) {
            println!(
                "{name:<16} {:>7} {:>9.3} {:>6.2} {:>6.2} {:>6.2} {:>8.3}",
                q.objects,
                q.mean_iou_3d,
                q.share_above_0_1,
                q.share_above_0_3,
                q.share_above_0_5,
                q.ceiling_mean_iou_3d
            );
        }
        println!(
            "{} proposals a frame: p50 {:.2} ms, p99 {:.2} ms, max {:.2} ms over {} frames; CPU time p50 {:.2} ms, p99 {:.2} ms; work p50 {:.0}, max {:.0}",
            self.proposals,
            self.p50_ms,
            self.p99_ms,
            self.max_ms,
            self.timed_frames,
            self.cpu_p50_ms,
            self.cpu_p99_ms,
            self.work_p50,
            self.work_max
        );
    }
}
