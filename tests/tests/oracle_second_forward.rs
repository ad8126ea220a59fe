//! Compares the paper's network with an independent implementation: every level of every frame that exists, site counts exactly,
//! sampled values within 1e-3 of the level's rms. It computes every bird's-eye cell once, then the active cells only.

use mluc_backbone::{Backbone, Coverage, Level, Place};
use mluc_head::Head;
use mluc_model::formula_weights;
use mluc_tests::{PaperFrame, feature_map, paper_frames, paper_network, read_json, rms};
use serde::Deserialize;
use std::collections::BTreeMap;

type Fallible<T = ()> = Result<T, Box<dyn std::error::Error>>;

/// Tolerance as a share of a level's rms.
const TOLERANCE: f64 = 1e-3;

/// A level in a frame's file.
#[derive(Deserialize)]
struct Expected {
    sites: usize,
    channels: usize,
    mean: f64,
    rms: f64,
    samples: Vec<Sample>,
}

#[derive(Deserialize)]
struct Sample {
    site: Vec<usize>,
    values: Vec<f64>,
}

/// A computed level: channels, the row of each site, and the values.
type Found = (usize, BTreeMap<Vec<usize>, usize>, Vec<f32>);

#[test]
fn every_level_of_every_frame_agrees() -> Fallible {
    let manifest = paper_network();
    let weights = formula_weights(&manifest.network);
    let mut backbone = Backbone::new(&manifest, &weights)?;
    let head = Head::new(&manifest, &weights)?;
    let empty = backbone.empty_rows()?;
    for frame in paper_frames()? {
        let expected = read_answers(&frame)?;
        for coverage in [Coverage::Everywhere, Coverage::Active] {
            let mut found = levels(&mut backbone, &frame.points, coverage);
            let features = feature_map(&backbone, empty.clone())?;
            let of_head = head.outputs(&features);
            let mut add = |name: &str, channels: usize, values: Vec<f32>| {
                let rows = cells_of(backbone.map_shape());
                found.insert(name.into(), (channels, rows, values));
            };
            add("features", backbone.feature_channels(), features);
            for ((name, channels), values) in manifest.network.heads().into_iter().zip(of_head) {
                add(name, channels, values);
            }
            for (name, expected) in &expected {
                let title = format!("{} {coverage:?} {name}", frame.name);
                let found = found.get(name).ok_or_else(|| format!("{title}: is not computed"))?;
                compare(&title, expected, found);
            }
        }
    }
    Ok(())
}

fn read_answers(frame: &PaperFrame) -> Fallible<BTreeMap<String, Expected>> {
    let levels = read_json(&frame.answers)["levels"].take();
    let levels: BTreeMap<String, Expected> = serde_json::from_value(levels)
        .map_err(|error| format!("{}: {error}", frame.answers.display()))?;
    let count = levels.len();
    assert!(count > 15, "{}: {count} levels", frame.name);
    let named = levels.into_iter().map(|(title, level)| (level_name(&title), level));
    Ok(named.collect())
}

/// `voxels (site = ...)` -> `voxels`; here a block has the name of its last layer.
fn level_name(title: &str) -> String {
    let name = title.split(' ').next().unwrap_or_default();
    match name {
        "backbone2d.block1" | "backbone2d.block2" => format!("{name}.5"),
        _ => name.into(),
    }
}

/// Runs a frame and returns every level of the backbone.
fn levels(backbone: &mut Backbone, points: &[[f32; 4]], over: Coverage) -> BTreeMap<String, Found> {
    let mut found = BTreeMap::new();
    backbone.run_observed(points, over, &mut |level: Level| {
        let rows = match level.place {
            Place::Sites(sites) => {
                let sites = sites.coordinates().iter().enumerate();
                sites.map(|(row, at)| (at.map(usize::from).to_vec(), row)).collect()
            }
            Place::Map(shape) => cells_of(shape),
        };
        let level_found = (level.channels, rows, level.values.to_vec());
        found.insert(level.name.to_string(), level_found);
    });
    found
}

fn cells_of([rows, columns]: [usize; 2]) -> BTreeMap<Vec<usize>, usize> {
    let place = |cell| (vec![cell / columns, cell % columns], cell);
    (0..rows * columns).map(place).collect()
}

fn compare(title: &str, expected: &Expected, (channels, rows, values): &Found) {
    let (sites, samples) = (expected.sites, expected.samples.len());
    let [found, wanted] = [(rows.len(), *channels), (sites, expected.channels)];
    assert_eq!(found, wanted, "{title}: sites, channels");
    let limit = TOLERANCE * expected.rms;
    let sum: f64 = values.iter().map(|value| f64::from(*value)).sum();
    for (what, found, expected) in [
        ("mean", sum / values.len() as f64, expected.mean),
        ("rms", rms(values.iter().copied()), expected.rms),
    ] {
        assert!((found - expected).abs() < limit, "{title}: {what} {found}, expected {expected}");
    }
    let mut worst: f64 = 0.0;
    for sample in &expected.samples {
        let row = rows.get(&sample.site);
        let row = row.unwrap_or_else(|| panic!("{title}: no site {:?}", sample.site));
        let row = &values[row * channels..][..*channels];
        for (value, expected) in row.iter().zip(&sample.values) {
            worst = worst.max((f64::from(*value) - expected).abs());
        }
    }
    let share = worst / expected.rms;
    println!("{title}: {sites} sites, {samples} samples, worst {share:.1e} of the rms");
    assert!(worst < limit && samples > 0, "{title}: {worst} of at most {limit}");
}
