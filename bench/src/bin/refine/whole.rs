//! Every cluster of whole frames: how many labelled objects are among them, and what it costs.

use anyhow::Result;
use mluc_bench::clock::timed;
use mluc_bench::inputs::sensor;
use mluc_geometry::iou_3d;
use mluc_refiner::{FrameClusterer, FrameClusters};
use serde_json::json;

use crate::quality::{Judged, print, quality};
use crate::scene::Frame;
use crate::timing::{PASSES, in_words, times};
use crate::{Setup, merged};

pub(crate) fn run(setup: &Setup, frames: &[Frame]) -> Result<()> {
    let mut clusterer = FrameClusterer::new(&setup.settings, &sensor())?;
    let mut out = FrameClusters::default();
    let mut laps = Vec::new();
    let mut clusters = 0;
    let mut judged = Vec::new();
    for pass in 0..=PASSES {
        for frame in frames {
            let lap = timed(|| clusterer.find(&frame.points, &mut out));
            if pass > 0 {
                laps.push(lap);
                continue;
            }
            clusters += out.clusters.len();
            judged.extend(frame.objects.iter().map(|object| {
                let overlaps = out.clusters.iter().map(|c| iou_3d(&c.shape, &object.shape));
                Judged {
                    class: object.class.clone(),
                    ious: vec![overlaps.fold(0.0, f64::max)],
                    ..Judged::default()
                }
            }));
        }
    }
    let each = clusters as f64 / frames.len().max(1) as f64;
    let about = json!({"mode": "everything", "frames": frames.len(), "clusters_per_frame": each});
    let report = merged([about, quality(&judged), times(&laps)]);
    setup.print(&report, || {
        let count = frames.len();
        println!("every cluster of {count} frames, {each:.0} a frame");
        print(&report);
        println!("{}", in_words(&report));
    })
}
