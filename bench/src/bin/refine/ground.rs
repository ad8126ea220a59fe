//! Our ground beside another program's: how many points both call the same, and what ours costs.
//!
//! The other's answer is a folder of files NAME.ground with one byte a point, 1 for ground
//! (`bench/peers/ground/patchwork.py` writes Patchwork++'s).

use std::path::Path;

use anyhow::{Context, Result, ensure};
use mluc_bench::clock::timed;
use mluc_bench::inputs::sensor;
use mluc_geometry::ground::{GroundGrid, ground_height_m};
use serde_json::json;

use crate::scene::Frame;
use crate::timing::{PASSES, in_words, times};
use crate::{Setup, merged};

pub(crate) fn run(setup: &Setup, frames: &[Frame], answers: &Path) -> Result<()> {
    let mut ground = GroundGrid::new(sensor().height_m);
    let mut laps = Vec::new();
    let clearance_m = setup.settings.ground_clearance_m as f32;
    // Points by ours and theirs: neither, theirs alone, ours alone, both.
    let mut counts = [0u64; 4];
    for frame in frames {
        let theirs = read(answers, frame)?;
        let points: &[[f32; 4]] = bytemuck::cast_slice(&frame.points);
        for _ in 0..PASSES {
            laps.push(timed(|| {
                ground.find(points);
            }));
        }
        for (&[x, y, z, _], &theirs) in points.iter().zip(&theirs) {
            let height_m = z - ground_height_m(ground.heights_m(), [x, y]);
            if !height_m.is_nan() {
                let ours = usize::from(height_m < clearance_m);
                counts[2 * ours + usize::from(theirs == 1)] += 1;
            }
        }
    }
    let [neither, theirs, ours, both] = counts.map(|count| count as f64);
    let points = (neither + theirs + ours + both).max(1.0);
    let agreement = (neither + both) / points;
    // Of what the other calls ground, the share that we do; and the other way round.
    let [theirs_in_ours, ours_in_theirs] =
        [theirs, ours].map(|alone| both / (both + alone).max(1.0));
    let about = json!({
        "frames": frames.len(), "points": points as u64, "agreement": agreement,
        "theirs_in_ours": theirs_in_ours, "ours_in_theirs": ours_in_theirs,
    });
    let report = merged([about, times(&laps)]);
    setup.print(&report, || {
        let [same, of_theirs, of_ours] =
            [agreement, theirs_in_ours, ours_in_theirs].map(|share| 100.0 * share);
        println!(
            "{} frames, {points} points: {same:.2} % the same; of their ground {of_theirs:.2} % is ours, of ours {of_ours:.2} % theirs\nours: {}",
            frames.len(),
            in_words(&report)
        );
    })
}

fn read(answers: &Path, frame: &Frame) -> Result<Vec<u8>> {
    let path = answers.join(format!("{}.ground", frame.name));
    let theirs = std::fs::read(&path).with_context(|| path.display().to_string())?;
    let (path, expected, found) = (path.display(), frame.points.len(), theirs.len());
    ensure!(
        found == expected,
        "{path}: expected {expected} labels, one a point, found {found}"
    );
    Ok(theirs)
}
