//! The point embedding of the OSIS baseline (Wong et al., CoRL 2019, as the paper modified it). Each point is embedded from the map's features,
//! close to the points of its object and far from others, on a trunk that is not trained further.
//!
//! A point is associated with the mean embedding of an instance, with one of a few background prototypes, or with the
//! unknown, which has one learned score. In training some instances have no prototype: the target of their points is the unknown.

use crate::{layers::add, mlp::Mlp};
use mluc_geometry::Random;
use mluc_model::{BASELINE, Manifest, WeightSet};

/// Number of values of an embedding.
pub const WIDTH: usize = 16;
const HIDDEN: usize = 64;
/// Number of background prototypes.
pub const BACKGROUNDS: usize = 4;
/// Inputs of a point in addition to its cell's features: height, and position in the cell.
const GEOMETRY: usize = 3;
/// Distance of an instance's point from its mean without a pull loss.
const PULL_WITHIN: f32 = 0.5;
/// Distance of the means of two instances without a push loss.
const PUSH_APART: f32 = 1.5;

/// Layers, background prototypes, and the score of the unknown.
#[derive(Clone, Debug, PartialEq)]
pub struct PointEmbedding {
    /// Layers from features to embedding. After their parameters: background prototypes (`[prototype][value]`) and the log weight of the unknown.
    pub mlp: Mlp,
}

/// The feature rows of a frame, by cell.
pub struct FrameFeatures<'a> {
    /// Row of each cell of the map; `u32::MAX`: no row.
    row_of: Vec<u32>,
    rows: &'a [f32],
    channels: usize,
    origin_m: [f32; 2],
    cell_m: [f32; 2],
    /// Number of rows and columns of the map.
    shape: [usize; 2],
    sensor_height_m: f32,
}

impl<'a> FrameFeatures<'a> {
    /// Features from the backbone's output.
    pub fn new(manifest: &Manifest, cells: &[u32], rows: &'a [f32]) -> FrameFeatures<'a> {
        let network = &manifest.network;
        let shape = network.map_shape();
        let mut row_of = vec![u32::MAX; shape[0] * shape[1]];
        for (row, cell) in cells.iter().enumerate() {
            row_of[*cell as usize] = row as u32;
        }
        let (low, high) = (network.grid.range_min_m, network.grid.range_max_m);
        let edge_m = |axis: usize, cells: usize| (high[axis] - low[axis]) / cells as f32;
        FrameFeatures {
            row_of,
            rows,
            channels: network.feature_channels(),
            origin_m: [low[0], low[1]],
            cell_m: [edge_m(0, shape[1]), edge_m(1, shape[0])],
            shape,
            sensor_height_m: manifest.sensor_height_m,
        }
    }

    /// Appends the inputs of a point; returns false outside the map.
    pub fn append(&self, at_m: [f32; 3], to: &mut Vec<f32>) -> bool {
        let place = [0, 1].map(|i| (at_m[i] - self.origin_m[i]) / self.cell_m[i]);
        let [rows, columns] = self.shape;
        let inside = |i: usize, limit: usize| (0.0..limit as f32).contains(&place[i]);
        if !(inside(0, columns) && inside(1, rows)) {
            return false;
        }
        let cell = place[1] as usize * columns + place[0] as usize;
        let channels = self.channels;
        match self.row_of[cell] {
            u32::MAX => to.resize(to.len() + channels, 0.0),
            row => to.extend_from_slice(&self.rows[row as usize * channels..][..channels]),
        }
        to.push((at_m[2] + self.sensor_height_m) / 2.0);
        to.extend(place.map(|p| p.fract() - 0.5));
        true
    }
}

/// A loss with its gradients.
#[derive(Debug, Default)]
pub struct PointLoss {
    /// The sum of association, pull and push.
    pub value: f64,
    /// Gradient of each point's embedding.
    pub embedding: Vec<f32>,
    /// Gradient of the background prototypes, then of the score of the unknown.
    pub own: Vec<f32>,
}

fn squared(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum()
}

fn logit(embedding: &[f32], prototype: &[f32]) -> f32 {
    -squared(embedding, prototype) / 2.0
}

fn row(values: &[f32], i: usize) -> &[f32] {
    &values[i * WIDTH..][..WIDTH]
}

/// `to += factor * (a - b)`.
fn add_difference(to: &mut [f32], factor: f32, a: &[f32], b: &[f32]) {
    for ((to, a), b) in to.iter_mut().zip(a).zip(b) {
        *to += factor * (a - b);
    }
}

impl PointEmbedding {
    /// The initial embedding, for a network with this number of feature channels.
    pub fn new(channels: usize, seed: u64) -> PointEmbedding {
        let mut random = Random::new(seed, &[0x0515]);
        let mut mlp = Mlp::new(&[channels + GEOMETRY, HIDDEN, HIDDEN, WIDTH], &mut random);
        let background = (0..BACKGROUNDS * WIDTH).map(|_| random.normal() as f32);
        mlp.parameters.extend(background.chain([-2.0]));
        PointEmbedding { mlp }
    }

    /// The layers, the background prototypes, the score of the unknown.
    fn parts(&self) -> (&[f32], &[f32], f32) {
        let all = &self.mlp.parameters;
        let (rest, unknown) = all.split_at(all.len() - 1);
        let (layers, background) = rest.split_at(rest.len() - BACKGROUNDS * WIDTH);
        (layers, background, unknown[0])
    }

    /// Probabilities of the instances (prototypes `[instance][value]`), of the background, and last of the unknown.
    pub fn associate(&self, embedding: &[f32], prototypes: &[f32]) -> Vec<f32> {
        let near = |prototype: &[f32]| logit(embedding, prototype);
        let (_, background, unknown) = self.parts();
        let mut logits: Vec<f32> = prototypes.chunks_exact(WIDTH).map(near).collect();
        let background: Vec<f32> = background.chunks_exact(WIDTH).map(near).collect();
        let most = logits.iter().chain(&background).copied().fold(unknown, f32::max);
        let sum: f32 = background.iter().map(|l| (l - most).exp()).sum();
        logits.extend([sum.ln() + most, unknown]);
        let sum: f32 = logits.iter().map(|l| (l - most).exp()).sum();
        logits.iter().map(|l| (l - most).exp() / sum).collect()
    }

    /// `owner`: the instance of each point, `None` for background; instances in `held_out` have no prototype, so the target of their points
    /// is the unknown. Means are treated as constants, except in the push loss.
    pub fn loss(&self, points: &[f32], owner: &[Option<usize>], held_out: &[bool]) -> PointLoss {
        let (means, counts) = means(points, owner, held_out.len());
        let mut loss = PointLoss {
            embedding: vec![0.0; points.len()],
            own: vec![0.0; BACKGROUNDS * WIDTH + 1],
            ..PointLoss::default()
        };
        let background = owner.iter().filter(|o| o.is_none()).count().max(1) as f32;
        let present = counts.iter().filter(|n| **n > 0).count().max(1) as f32;
        let used: Vec<usize> = (0..held_out.len()).filter(|k| !held_out[*k]).collect();
        let (_, own, unknown) = self.parts();
        let prototypes = used.iter().map(|k| row(&means, *k));
        let prototypes: Vec<&[f32]> = prototypes.chain(own.chunks_exact(WIDTH)).collect();
        for (i, owner) in owner.iter().enumerate() {
            let weight = match owner {
                Some(k) => 0.5 / (present * counts[*k] as f32),
                None => 0.5 / background,
            };
            let phi = row(points, i);
            let d_phi = &mut loss.embedding[i * WIDTH..][..WIDTH];
            let is_target = |at: usize| match owner {
                None => at >= used.len() && at < prototypes.len(),
                Some(k) if held_out[*k] => at == prototypes.len(),
                Some(k) => at < used.len() && used[at] == *k,
            };
            let mut logits: Vec<f32> = prototypes.iter().map(|m| logit(phi, m)).collect();
            logits.push(unknown);
            let (value, slopes) = cross_entropy(&logits, is_target);
            loss.value += f64::from(weight * value);
            for (at, slope) in slopes.into_iter().enumerate() {
                let d = weight * slope;
                if at == prototypes.len() {
                    loss.own[BACKGROUNDS * WIDTH] += d;
                    continue;
                }
                add_difference(d_phi, -d, phi, prototypes[at]);
                if let Some(number) = at.checked_sub(used.len()) {
                    let to = &mut loss.own[number * WIDTH..][..WIDTH];
                    add_difference(to, d, phi, prototypes[at]);
                }
            }
            if let Some(k) = owner {
                let mean = row(&means, *k);
                let distance = squared(phi, mean).sqrt();
                let far = (distance - PULL_WITHIN).max(0.0);
                loss.value += f64::from(weight * far * far);
                let factor = 2.0 * weight * far / distance.max(1e-6);
                add_difference(d_phi, factor, phi, mean);
            }
        }
        push(owner, &means, &counts, &mut loss);
        loss
    }

    /// Writes it into a model's weights.
    pub fn write(&self, weights: &mut WeightSet) {
        let (layers, background, unknown) = self.parts();
        for (part, shape, values) in [
            ("mlp", vec![layers.len()], layers),
            ("background", vec![BACKGROUNDS, WIDTH], background),
            ("unknown", vec![1], &[unknown]),
        ] {
            let name = format!("{BASELINE}osis.{part}");
            weights.insert(name, shape, values.to_vec());
        }
    }

    /// Reads it from a model's weights; `None` where it is missing or has other sizes.
    pub fn read(weights: &WeightSet, channels: usize) -> Option<PointEmbedding> {
        let mut embedding = PointEmbedding::new(channels, 0);
        let find = |part: &str| weights.find(&format!("{BASELINE}osis.{part}"));
        let (layers, background, unknown) = (find("mlp")?, find("background")?, find("unknown")?);
        let fits = background.data.len() == BACKGROUNDS * WIDTH && unknown.data.len() == 1;
        let all = [&layers.data[..], &background.data, &unknown.data].concat();
        let parameters = &mut embedding.mlp.parameters;
        (fits && all.len() == parameters.len()).then(|| *parameters = all)?;
        Some(embedding)
    }

    /// The loss of a frame's points from their inputs, and the gradient of all parameters.
    pub(crate) fn step(
        &self,
        input: Vec<f32>,
        owner: &[Option<usize>],
        held_out: &[bool],
    ) -> (f64, Vec<f32>) {
        let trace = self.mlp.forward(input);
        let loss = self.loss(trace.output(), owner, held_out);
        let mut gradient = self.mlp.backward(&trace, loss.embedding);
        let layers = gradient.len() - loss.own.len();
        gradient[layers..].copy_from_slice(&loss.own);
        (loss.value, gradient)
    }
}

/// Cross entropy of the softmax of `logits` for any of the targets, and the derivative for each logit.
fn cross_entropy(logits: &[f32], is_target: impl Fn(usize) -> bool) -> (f32, Vec<f32>) {
    let most = logits.iter().copied().fold(f32::MIN, f32::max);
    let e: Vec<f32> = logits.iter().map(|l| (l - most).exp()).collect();
    let sum: f32 = e.iter().sum();
    let targets = e.iter().enumerate().filter(|(at, _)| is_target(*at));
    let wanted = targets.map(|(_, e)| e).sum::<f32>().max(1e-30);
    let slope = |(at, e): (usize, &f32)| e / sum - if is_target(at) { e / wanted } else { 0.0 };
    let slopes = e.iter().enumerate().map(slope).collect();
    ((sum / wanted).ln(), slopes)
}

/// Each point that belongs to an instance, with the instance's number.
fn owned(owner: &[Option<usize>]) -> impl Iterator<Item = (usize, usize)> {
    owner.iter().enumerate().filter_map(|(i, k)| Some((i, (*k)?)))
}

/// Mean embedding of each instance, and its number of points.
pub fn means(points: &[f32], owner: &[Option<usize>], instances: usize) -> (Vec<f32>, Vec<usize>) {
    let (mut means, mut counts) = (vec![0.0f32; instances * WIDTH], vec![0; instances]);
    for (i, k) in owned(owner) {
        counts[k] += 1;
        add(&mut means[k * WIDTH..][..WIDTH], row(points, i));
    }
    for (mean, count) in means.chunks_exact_mut(WIDTH).zip(&counts) {
        mean.iter_mut().for_each(|m| *m /= (*count).max(1) as f32);
    }
    (means, counts)
}

/// Push loss: means of two instances closer than [`PUSH_APART`] push each other's points away.
fn push(owner: &[Option<usize>], means: &[f32], counts: &[usize], loss: &mut PointLoss) {
    let present: Vec<usize> = (0..counts.len()).filter(|k| counts[*k] > 0).collect();
    let pairs = (present.len() * present.len().saturating_sub(1)).max(1) as f32;
    let mut gradient = vec![0.0f32; means.len()];
    for &a in &present {
        for &b in present.iter().filter(|b| **b != a) {
            let (mean_a, mean_b) = (row(means, a), row(means, b));
            let distance = squared(mean_a, mean_b).sqrt();
            let near = (PUSH_APART - distance).max(0.0);
            loss.value += f64::from(near * near / pairs);
            let factor = -4.0 * near / (pairs * distance.max(1e-6));
            add_difference(&mut gradient[a * WIDTH..][..WIDTH], factor, mean_a, mean_b);
        }
    }
    for (i, k) in owned(owner) {
        for c in 0..WIDTH {
            loss.embedding[i * WIDTH + c] += gradient[k * WIDTH + c] / counts[k] as f32;
        }
    }
}

#[cfg(test)]
#[path = "embedding_tests.rs"]
mod tests;
