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
}

/// Quality, then time.
pub(crate) fn measure(
    frames: &[Frame],
    settings: Settings,
    proposals: usize,
    anywhere: bool,
) -> Result<Report> {
    let mode = settings.mode;
    let mut refiner = crate::refiner(settings)?;
    let judged = judge(frames, &mut refiner);
    let times = time(frames, &mut refiner, proposals, anywhere);
    let [p50_ms, p99_ms, max_ms] = percentiles(times.iter().map(|t| t.wall_ms));
    let [cpu_p50_ms, cpu_p99_ms, _] = percentiles(times.iter().map(|t| t.cpu_ms));
    Ok(Report {
        refiner: mode.name(),
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
            "{} proposals a frame: p50 {:.2} ms, p99 {:.2} ms, max {:.2} ms over {} frames; CPU time p50 {:.2} ms, p99 {:.2} ms",
            self.proposals,
            self.p50_ms,
            self.p99_ms,
            self.max_ms,
            self.timed_frames,
            self.cpu_p50_ms,
            self.cpu_p99_ms
        );
    }
}
