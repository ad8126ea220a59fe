//! Simulated proposals around each labelled object: the figures of one refiner.

use anyhow::Result;
use mluc_geometry::quantile_of;
use serde_json::json;

use crate::quality::{judge, print, quality};
use crate::scene::Frame;
use crate::timing::{in_words, time};
use crate::{Setup, merged};

pub(crate) fn run(setup: &Setup, frames: &[Frame], proposals: usize) -> Result<()> {
    let mut refiner = setup.refiner()?;
    let judged = judge(frames, &mut refiner);
    let (times, work) = time(frames, &mut refiner, proposals);
    let [work_p50, work_max] = [0.5, 1.0].map(|q| quantile_of(work.clone(), q).unwrap_or(0.0));
    let (name, count) = (setup.settings.variant.name(), frames.len());
    let about = json!({
        "refiner": name, "frames": count, "proposals": proposals, "work_p50": work_p50, "work_max": work_max,
    });
    let report = merged([about, quality(&judged), times]);
    setup.print(&report, || {
        println!("refiner {name}, {count} frames");
        print(&report);
        let times = in_words(&report);
        println!(
            "{proposals} proposals a frame: {times}; work p50 {work_p50:.0}, max {work_max:.0}"
        );
    })
}
