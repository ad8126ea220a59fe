//! Simulated proposals around each labelled object: the figures of one refiner, every object in a list, or several settings
//! side by side.

use std::collections::BTreeSet;

use anyhow::{Context, Result};
use mluc_bench::clock::timed;
use mluc_geometry::{mean_and_spread, quantile_of};
use mluc_refiner::Settings;
use serde_json::{Value, json};

use crate::quality::{by_class, judge, print, quality};
use crate::scene::Frame;
use crate::timing::{in_words, time};
use crate::{Setup, figure, merged};

pub(crate) fn run(setup: &Setup, frames: &[Frame], proposals: usize, anywhere: bool) -> Result<()> {
    let mut refiner = setup.refiner(&setup.settings)?;
    let judged = judge(frames, &mut refiner);
    let (times, work) = time(frames, &mut refiner, proposals, anywhere);
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

pub(crate) fn list(setup: &Setup, frames: &[Frame]) -> Result<()> {
    let judged = judge(frames, &mut setup.refiner(&setup.settings)?);
    let objects = frames
        .iter()
        .flat_map(|f| f.objects.iter().map(|o| (f.number, &o.shape)));
    println!(
        "frame class IoU of the first, mean, ceiling | label: place, size, heading | found: disposition, place, size, heading, points"
    );
    for ((frame, label), own) in objects.zip(&judged) {
        let [mean, _] = mean_and_spread(&own.ious);
        let first = own.ious.first().copied().unwrap_or(0.0);
        let ceiling = own.ceiling.unwrap_or(0.0);
        print!(
            "{frame:>4} {:<10} {first:.2} {mean:.2} {ceiling:.2} | {:6.1?} {:.1?} {:.1} |",
            own.class, label.center_m, label.size_m, label.yaw_rad
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

/// A table with a row for each value of each `path=v1,v2,...`.
pub(crate) fn vary(setup: &Setup, frames: &[Frame], words: &[String]) -> Result<()> {
    let mut rows = vec![("as set".to_owned(), setup.settings.clone())];
    for word in words {
        let (path, values) = word
            .split_once('=')
            .with_context(|| format!("--vary {word}: expected path=value,value"))?;
        // Lists have commas of their own: values are then parted by semicolons.
        let part = if values.contains(';') { ';' } else { ',' };
        for value in values.split(part) {
            let settings = changed(&setup.settings, path, value)?;
            rows.push((format!("{path}={value}"), settings));
        }
    }
    table(setup, frames, &rows)
}

fn changed(settings: &Settings, path: &str, value: &str) -> Result<Settings> {
    let mut tree = serde_json::to_value(settings)?;
    let pointer = format!("/{}", path.replace('.', "/"));
    let place = tree
        .pointer_mut(&pointer)
        .with_context(|| format!("no setting {path}"))?;
    *place = serde_json::from_str(value).unwrap_or_else(|_| Value::String(value.to_owned()));
    serde_json::from_value(tree).with_context(|| format!("{path}={value}"))
}

/// Mean IoU and share above 0.3, overall, as the mean over the classes, and mean IoU by class.
pub(crate) fn table(setup: &Setup, frames: &[Frame], rows: &[(String, Settings)]) -> Result<()> {
    let objects = frames.iter().flat_map(|frame| &frame.objects);
    let classes: BTreeSet<&str> = objects.map(|object| object.class.as_str()).collect();
    print!(
        "{:<44} {:>6} {:>6} {:>7} {:>7}",
        "settings", "mean", ">0.3", "classes", "CPU s"
    );
    classes.iter().for_each(|class| print!(" {class:>10}"));
    println!();
    for (name, settings) in rows {
        let mut refiner = setup.refiner(settings)?;
        let mut judged = Vec::new();
        let took = timed(|| judged = judge(frames, &mut refiner));
        let all = quality(&judged);
        let of_classes: Vec<f64> = by_class(&all)
            .map(|own| figure(own.1, "mean_iou_3d"))
            .collect();
        let [mean, _] = mean_and_spread(&of_classes);
        let [iou, share] = ["mean_iou_3d", "share_above_0_3"].map(|key| figure(&all, key));
        let cpu_s = took.cpu / 1e3;
        print!("{name:<44} {iou:>6.4} {share:>6.3} {mean:>7.4} {cpu_s:>7.1}");
        of_classes.iter().for_each(|iou| print!(" {iou:>10.3}"));
        println!();
    }
    Ok(())
}
