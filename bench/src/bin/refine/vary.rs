//! Settings side by side: one varied at a time, or any rows.

use std::collections::BTreeSet;

use anyhow::{Context, Result};
use mluc_refiner::Settings;
use serde_json::Value;

use crate::quality::{Judged, judge, quality};
use crate::scene::Frame;

/// A table with a row for each value of each `path=v1,v2,...`.
pub(crate) fn run(frames: &[Frame], settings: &Settings, words: &[String]) -> Result<()> {
    let mut rows = vec![("as set".to_owned(), settings.clone())];
    for word in words {
        let (path, values) = word
            .split_once('=')
            .with_context(|| format!("--vary {word}: expected path=value,value"))?;
        // Lists have commas of their own: values are then parted by semicolons.
        let part = if values.contains(';') { ';' } else { ',' };
        for value in values.split(part) {
            rows.push((format!("{path}={value}"), changed(settings, path, value)?));
        }
    }
    table(frames, &rows)
}

fn changed(settings: &Settings, path: &str, value: &str) -> Result<Settings> {
    let mut tree = serde_json::to_value(settings)?;
    let pointer = format!("/{}", path.replace('.', "/"));
    let place = tree
        .pointer_mut(&pointer)
        .with_context(|| format!("no setting {path}"))?;
    *place = match serde_json::from_str(value) {
        Ok(value) => value,
        Err(_) => Value::String(value.to_owned()),
    };
    serde_json::from_value(tree).with_context(|| format!("{path}={value}"))
}

/// Mean IoU and share above 0.3, overall, as the mean over the classes, and mean IoU by class.
pub(crate) fn table(frames: &[Frame], rows: &[(String, Settings)]) -> Result<()> {
    let classes: BTreeSet<&str> = frames
        .iter()
        .flat_map(|frame| frame.objects.iter().map(|o| o.class.as_str()))
        .collect();
    print!(
        "{:<44} {:>6} {:>6} {:>7} {:>7}",
        "settings", "mean", ">0.3", "classes", "CPU s"
    );
    classes.iter().for_each(|class| print!(" {class:>10}"));
    println!();
    for (name, settings) in rows {
        let mut refiner = crate::refiner(settings.clone())?;
        let mut judged = Vec::new();
        let took = crate::timing::timed(|| judged = judge(frames, &mut refiner));
        let all = quality(&judged.iter().collect::<Vec<_>>());
        let by_class: Vec<f64> = classes
            .iter()
            .map(|class| {
                let own: Vec<&Judged> = judged.iter().filter(|o| o.class == *class).collect();
                quality(&own).mean_iou_3d
            })
            .collect();
        let mean = by_class.iter().sum::<f64>() / by_class.len().max(1) as f64;
        print!(
            "{name:<44} {:>6.4} {:>6.3} {mean:>7.4} {:>7.1}",
            all.mean_iou_3d,
            all.share_above_0_3,
            took.cpu_ms / 1e3
        );
        by_class.iter().for_each(|mean| print!(" {mean:>10.3}"));
        println!();
    }
    Ok(())
}
