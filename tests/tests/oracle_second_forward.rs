//! The paper's network against an independent implementation: every level of every frame found, site counts exactly,
//! sampled values within 1e-3 of the level's rms; once with every bird's-eye cell computed, once with the active ones.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use mluc_backbone::{Backbone, Coverage, Level, Place};
use mluc_head::Head;
use mluc_model::{Grid, Manifest, Network, formula_weights};
use mluc_tests::oracle;
use serde_json::Value;

type Fallible<T = ()> = Result<T, Box<dyn std::error::Error>>;

/// Of a level's rms.
const TOLERANCE: f64 = 1e-3;

/// A level as the file shows it.
struct Expected {
    sites: usize,
    channels: usize,
    mean: f64,
    rms: f64,
    samples: Vec<(Vec<usize>, Vec<f64>)>,
}

/// A level as computed here: the values and where the row of each site is.
struct Found {
    channels: usize,
    rows: BTreeMap<Vec<usize>, usize>,
    values: Vec<f32>,
}

#[test]
fn every_level_of_every_frame_agrees() -> Fallible {
    let Some(frames) = frames()? else {
        return Ok(());
    };
    let manifest = manifest();
    let weights = formula_weights(&manifest.network);
    let mut backbone = Backbone::new(&manifest, &weights)?;
    let head = Head::new(&manifest, &weights)?;
    let empty = backbone.empty_rows()?;
    for frame in frames {
        let expected = read_expected(&frame)?;
        let points = read_points(&frame.with_extension("bin"))?;
        for coverage in [Coverage::Everywhere, Coverage::Active] {
            let mut found = levels(&mut backbone, &points, coverage)?;
            let features = features(&backbone, &empty, &mut found);
            for ((name, channels), values) in manifest
                .network
                .heads()
                .into_iter()
                .zip(head.outputs(&features))
            {
                found.insert(
                    name.into(),
                    Found {
                        channels,
                        values,
                        rows: found["features"].rows.clone(),
                    },
                );
            }
            for (name, expected) in &expected {
                let found = found
                    .get(name)
                    .ok_or_else(|| format!("level {name} is not computed"))?;
                compare(
                    &format!("{} {coverage:?} {name}", frame.display()),
                    expected,
                    found,
                );
            }
        }
    }
    Ok(())
}

#[test]
fn threads_do_not_change_a_bit_of_a_full_scan() -> Fallible {
    let Some(frames) = frames()? else {
        return Ok(());
    };
    let mut stages = Stages::new(&manifest())?;
    for frame in frames {
        let points = read_points(&frame.with_extension("bin"))?;
        let (one, two) = (stages.run(&points, 1)?, stages.run(&points, 2)?);
        assert!(one == two, "{}: one thread and two", frame.display());
    }
    Ok(())
}

/// Both stages, as the vehicle runs them.
struct Stages {
    backbone: Backbone,
    head: Head,
}

impl Stages {
    fn new(manifest: &Manifest) -> Fallible<Stages> {
        let weights = formula_weights(&manifest.network);
        Ok(Stages {
            backbone: Backbone::new(manifest, &weights)?,
            head: Head::new(manifest, &weights)?,
        })
    }

    /// The bits of the feature rows and the detections.
    fn run(&mut self, points: &[[f32; 4]], threads: usize) -> Fallible<Vec<u32>> {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()?;
        let bits = pool.install(|| -> Result<Vec<u32>, String> {
            let (count, channels) = (
                self.backbone.run(points).rows,
                self.backbone.feature_channels(),
            );
            let (mut cells, mut rows, mut detections) =
                (vec![0; count], vec![0.0; count * channels], vec![]);
            self.backbone
                .write_rows(&mut cells, &mut rows)
                .map_err(|error| error.to_string())?;
            self.head
                .run(&cells, &rows, &mut detections)
                .map_err(|error| error.to_string())?;
            let mut bits = bytemuck::cast_slice(&rows).to_vec();
            bits.extend_from_slice(bytemuck::cast_slice(&detections));
            assert!(
                bits.len() > 1000 && !detections.is_empty(),
                "the frame has contents"
            );
            Ok(bits)
        });
        Ok(bits?)
    }
}

/// The expected answers in the oracle's folder; none where it is not asked for, an error where it is empty.
fn frames() -> Fallible<Option<Vec<PathBuf>>> {
    let Some(folder) = oracle() else {
        return Ok(None);
    };
    let folder = folder.join("second_forward");
    let entries =
        std::fs::read_dir(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let mut frames = entries
        .map(|entry| Ok(entry?.path()))
        .collect::<Fallible<Vec<_>>>()?;
    frames.retain(|path| {
        path.extension()
            .is_some_and(|extension| extension == "json")
    });
    frames.sort();
    if frames.is_empty() {
        return Err(format!("{} holds no frame", folder.display()).into());
    }
    Ok(Some(frames))
}

/// No voxel budget but the contract's points.
fn manifest() -> Manifest {
    let grid = Grid {
        voxels_max: mluc_model::VOXELS_MAX,
        ..Grid::kitti_second()
    };
    Manifest::untrained("oracle", Network::second(grid, 3))
}

fn read_points(path: &Path) -> Fallible<Vec<[f32; 4]>> {
    let bytes = std::fs::read(path).map_err(|error| format!("{}: {error}", path.display()))?;
    Ok(bytes
        .chunks_exact(16)
        .map(bytemuck::pod_read_unaligned)
        .collect())
}

fn read_expected(path: &Path) -> Fallible<BTreeMap<String, Expected>> {
    let file: Value = serde_json::from_slice(&std::fs::read(path)?)?;
    let levels = file["levels"].as_object().ok_or("no levels")?;
    let expected: BTreeMap<_, _> = levels
        .iter()
        .map(|(name, level)| {
            Ok((
                level_name(name),
                read_level(level).ok_or("a level without its numbers")?,
            ))
        })
        .collect::<Fallible<_>>()?;
    assert!(
        expected.len() > 15,
        "{}: {} levels",
        path.display(),
        expected.len()
    );
    Ok(expected)
}

/// `voxels (site = ...)` -> `voxels`; a block is known here by its last layer.
fn level_name(title: &str) -> String {
    let name = title.split(' ').next().unwrap_or_default();
    match name {
        "backbone2d.block1" | "backbone2d.block2" => format!("{name}.5"),
        _ => name.into(),
    }
}

fn read_level(level: &Value) -> Option<Expected> {
    let sample = |sample: &Value| {
        let site = sample["site"]
            .as_array()?
            .iter()
            .map(|at| Some(at.as_u64()? as usize))
            .collect::<Option<_>>()?;
        let values = sample["values"]
            .as_array()?
            .iter()
            .map(Value::as_f64)
            .collect::<Option<_>>()?;
        Some((site, values))
    };
    Some(Expected {
        sites: level["sites"].as_u64()? as usize,
        channels: level["channels"].as_u64()? as usize,
        mean: level["mean"].as_f64()?,
        rms: level["rms"].as_f64()?,
        samples: level["samples"]
            .as_array()?
            .iter()
            .map(sample)
            .collect::<Option<_>>()?,
    })
}

/// Runs a frame and keeps every level.
fn levels(
    backbone: &mut Backbone,
    points: &[[f32; 4]],
    coverage: Coverage,
) -> Fallible<BTreeMap<String, Found>> {
    let mut found = BTreeMap::new();
    backbone.run_observed(points, coverage, &mut |level: Level| {
        let rows: BTreeMap<Vec<usize>, usize> = match level.place {
            Place::Sites(sites) => sites
                .coordinates()
                .iter()
                .enumerate()
                .map(|(row, at)| (at.map(usize::from).to_vec(), row))
                .collect(),
            Place::Map(shape) => cells_of(shape),
        };
        let values = level.values.to_vec();
        found.insert(
            level.name.to_string(),
            Found {
                channels: level.channels,
                rows,
                values,
            },
        );
    });
    Ok(found)
}

fn cells_of([rows, columns]: [usize; 2]) -> BTreeMap<Vec<usize>, usize> {
    (0..rows * columns)
        .map(|cell| (vec![cell / columns, cell % columns], cell))
        .collect()
}

/// The written rows laid over those of the empty scene.
fn features(backbone: &Backbone, empty: &[f32], found: &mut BTreeMap<String, Found>) -> Vec<f32> {
    let channels = backbone.feature_channels();
    let count = backbone.rows();
    let (mut cells, mut rows) = (vec![0; count], vec![0.0; count * channels]);
    backbone
        .write_rows(&mut cells, &mut rows)
        .expect("room for every row");
    let mut values = empty.to_vec();
    for (cell, row) in cells.iter().zip(rows.chunks_exact(channels)) {
        values[*cell as usize * channels..][..channels].copy_from_slice(row);
    }
    let rows = cells_of(backbone.map_shape());
    found.insert(
        "features".into(),
        Found {
            channels,
            rows,
            values: values.clone(),
        },
    );
    values
}

fn compare(title: &str, expected: &Expected, found: &Found) {
    assert_eq!(
        (found.rows.len(), found.channels),
        (expected.sites, expected.channels),
        "{title}: sites, channels"
    );
    let limit = TOLERANCE * expected.rms;
    let count = found.values.len() as f64;
    let mean = found.values.iter().map(|v| f64::from(*v)).sum::<f64>() / count;
    let rms = (found
        .values
        .iter()
        .map(|v| f64::from(*v).powi(2))
        .sum::<f64>()
        / count)
        .sqrt();
    assert!(
        (mean - expected.mean).abs() < limit,
        "{title}: mean {mean}, expected {}",
        expected.mean
    );
    assert!(
        (rms - expected.rms).abs() < limit,
        "{title}: rms {rms}, expected {}",
        expected.rms
    );
    let mut worst: f64 = 0.0;
    for (site, values) in &expected.samples {
        let row = found
            .rows
            .get(site)
            .unwrap_or_else(|| panic!("{title}: no site {site:?}"));
        let row = &found.values[row * found.channels..][..found.channels];
        for (value, expected) in row.iter().zip(values) {
            worst = worst.max((f64::from(*value) - expected).abs());
        }
    }
    println!(
        "{title}: {} sites, {} samples, worst {:.1e} of the rms",
        expected.sites,
        expected.samples.len(),
        worst / expected.rms
    );
    assert!(
        worst < limit && !expected.samples.is_empty(),
        "{title}: {worst} of at most {limit}"
    );
}
