//! Statistics and samples of the training split: mean sizes of its objects, and objects to paste into other scans.

use crate::{error::TrainError, source::ScanSource};
use mluc_geometry::{Box3, Inside};
use rayon::prelude::*;

/// Minimum number of points of an object to paste (the public SECOND configuration).
const SAMPLE_POINTS_MIN: usize = 5;
/// Maximum number of objects kept per class, to limit memory.
const SAMPLES_PER_CLASS_MAX: usize = 4000;
/// Number of frames read at a time.
const CHUNK_FRAMES: usize = 64;

/// An object cut out of its scan.
#[derive(Clone, Debug, PartialEq)]
pub struct Sample {
    /// Known class; `None` for a synthetic unknown object.
    pub class: Option<usize>,
    /// Its box in the original scan.
    pub bounds: Box3,
    /// Its points, at their original positions.
    pub points: Vec<[f32; 4]>,
}

/// Objects, one list per class.
pub type Database = Vec<Vec<Sample>>;

/// Mean l, w, h (m) and mean z of the bottom (m) of a class.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MeanBox {
    /// Mean l, w, h.
    pub size_m: [f32; 3],
    /// Mean z of the bottom.
    pub bottom_z_m: f32,
    /// Number of averaged objects.
    pub count: usize,
}

/// The mean box of each class over every frame.
pub fn mean_boxes(source: &ScanSource, classes: usize) -> Result<Vec<MeanBox>, TrainError> {
    let labelled = (0..source.count()).into_par_iter();
    let labelled: Result<Vec<_>, _> = labelled.map(|f| source.labelled(f)).collect();
    let mut sums = vec![([0.0f64; 4], 0usize); classes];
    for (class, bounds) in labelled?.into_iter().flatten() {
        let (sum, count) = &mut sums[class];
        let bottom = bounds.center_m[2] - bounds.size_m[2] / 2.0;
        let [l, w, h] = bounds.size_m;
        sum.iter_mut().zip([l, w, h, bottom]).for_each(|(sum, value)| *sum += value);
        *count += 1;
    }
    let mean = |(sum, count): ([f64; 4], usize)| {
        let [l, w, h, bottom_z_m] = sum.map(|s| (s / count.max(1) as f64) as f32);
        MeanBox { size_m: [l, w, h], bottom_z_m, count }
    };
    Ok(sums.into_iter().map(mean).collect())
}

/// Collects the objects of `frames` frames, spread over all.
pub fn build(source: &ScanSource, classes: usize, frames: usize) -> Result<Database, TrainError> {
    let mut database = vec![vec![]; classes];
    let wanted = frames.min(source.count());
    let frames: Vec<usize> = (0..wanted).map(|i| i * source.count() / wanted).collect();
    for chunk in frames.chunks(CHUNK_FRAMES) {
        let cut = chunk.par_iter().map(|f| cut_out(source, *f));
        let cut: Result<Vec<_>, TrainError> = cut.collect();
        for (class, sample) in cut?.into_iter().flatten() {
            let list: &mut Vec<Sample> = &mut database[class];
            if list.len() < SAMPLES_PER_CLASS_MAX {
                list.push(sample);
            }
        }
    }
    Ok(database)
}

fn cut_out(source: &ScanSource, frame: usize) -> Result<Vec<(usize, Sample)>, TrainError> {
    let (scan, visible) = source.changed(frame, |_| ())?;
    let objects = scan.objects.iter().zip(visible);
    let wanted = objects.filter(|(o, visible)| *visible && o.points >= SAMPLE_POINTS_MIN);
    let samples = wanted.filter_map(|(object, _)| {
        let own = Inside::of(&object.bounds, 0.0);
        let points = scan.points.iter().filter(|p| own.has_point(p));
        let sample = Sample {
            class: object.class,
            bounds: object.bounds,
            points: points.copied().collect(),
        };
        Some((object.class?, sample))
    });
    Ok(samples.collect())
}
