//! The point embedding of the OSIS baseline (Wong et al., CoRL 2019, as the paper modified it): each point's place on the map's
//! features, brought near to the points of its object and away from others, on a trunk that is not trained further.
//!
//! A point is associated with the mean embedding of an instance, with one of a few background prototypes, or with the
//! unknown, which is one learned number. In training some instances have no prototype: their points are to be unknown.

use mluc_model::{BASELINE, Manifest, WeightSet};

use super::mlp::Mlp;
use super::random::Random;

/// Values of an embedding.
pub const WIDTH: usize = 16;
const HIDDEN: usize = 64;
/// Prototypes of the background.
pub const BACKGROUNDS: usize = 4;
/// What is told of a point beside its cell's features: height, and place in the cell.
const GEOMETRY: usize = 3;
/// Points of an instance may lie this far from their mean,
const PULL_WITHIN: f32 = 0.5;
/// and means of two instances have to lie this far apart.
const PUSH_APART: f32 = 1.5;

/// Layers, background prototypes (`[prototype][value]`), and the unknown's score.
#[derive(Clone, Debug, PartialEq)]
pub struct PointEmbedding {
    /// Features to embedding.
    pub mlp: Mlp,
    /// [`BACKGROUNDS`] times [`WIDTH`].
    pub background: Vec<f32>,
    /// Log weight of the unknown.
    pub unknown: f32,
}

/// A frame's feature rows by cell.
pub struct FrameFeatures<'a> {
    /// Row of each cell of the map; `u32::MAX`: none.
    row_of: Vec<u32>,
    rows: &'a [f32],
    channels: usize,
    origin_m: [f32; 2],
    cell_m: [f32; 2],
    columns: usize,
    sensor_height_m: f32,
}

impl<'a> FrameFeatures<'a> {
    /// From what the backbone wrote.
    pub fn new(manifest: &Manifest, cells: &[u32], rows: &'a [f32]) -> FrameFeatures<'a> {
        let network = &manifest.network;
        let [map_rows, columns] = network.map_shape();
        let mut row_of = vec![u32::MAX; map_rows * columns];
        cells
            .iter()
            .enumerate()
            .for_each(|(row, cell)| row_of[*cell as usize] = row as u32);
        let low = network.grid.range_min_m;
        FrameFeatures {
            row_of,
            rows,
            channels: network.feature_channels(),
            origin_m: [low[0], low[1]],
            cell_m: network.cell_size_m(),
            columns,
            sensor_height_m: manifest.sensor_height_m,
        }
    }

    /// Appends what is told of a point; false outside of the map.
    pub fn append(&self, at_m: [f32; 3], to: &mut Vec<f32>) -> bool {
        let place = [0, 1].map(|i| (at_m[i] - self.origin_m[i]) / self.cell_m[i]);
        let map_rows = self.row_of.len() / self.columns.max(1);
        let inside = place[0] >= 0.0
            && place[1] >= 0.0
            && place[0] < self.columns as f32
            && place[1] < map_rows as f32;
        if !inside {
            return false;
        }
        let cell = place[1] as usize * self.columns + place[0] as usize;
        match self.row_of[cell] {
            u32::MAX => to.resize(to.len() + self.channels, 0.0),
            row => {
                to.extend_from_slice(&self.rows[row as usize * self.channels..][..self.channels])
            }
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
    /// By point.
    pub embedding: Vec<f32>,
    /// By background prototype.
    pub background: Vec<f32>,
    /// Of the unknown's score.
    pub unknown: f32,
}

fn squared(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum()
}

impl PointEmbedding {
    /// Before training, for a network of so many feature channels.
    pub fn new(channels: usize, seed: u64) -> PointEmbedding {
        let mut random = Random::new(seed, &[0x0515]);
        let mlp = Mlp::new(&[channels + GEOMETRY, HIDDEN, HIDDEN, WIDTH], &mut random);
        PointEmbedding {
            mlp,
            background: (0..BACKGROUNDS * WIDTH)
                .map(|_| random.normal() as f32)
                .collect(),
            unknown: -2.0,
        }
    }

    /// Probabilities of the instances (prototypes `[instance][value]`), the background, and the unknown, which is last.
    pub fn associate(&self, embedding: &[f32], prototypes: &[f32]) -> Vec<f32> {
        let near = |prototype: &[f32]| -squared(embedding, prototype) / 2.0;
        let mut logits: Vec<f32> = prototypes.chunks_exact(WIDTH).map(near).collect();
        let background: Vec<f32> = self.background.chunks_exact(WIDTH).map(near).collect();
        let most = logits
            .iter()
            .chain(&background)
            .copied()
            .fold(self.unknown, f32::max);
        logits.push(
            background
                .iter()
                .map(|l| (l - most).exp())
                .sum::<f32>()
                .ln()
                + most,
        );
        logits.push(self.unknown);
        let sum: f32 = logits.iter().map(|l| (l - most).exp()).sum();
        logits.iter().map(|l| (l - most).exp() / sum).collect()
    }

    /// `owner`: the instance of each point, `None` for background; instances `held_out` have no prototype, so that their points are
    /// to be unknown. Means are taken as given but for the push.
    pub fn loss(&self, points: &[f32], owner: &[Option<usize>], held_out: &[bool]) -> PointLoss {
        let instances = held_out.len();
        let (means, counts) = means(points, owner, instances);
        let mut loss = PointLoss {
            embedding: vec![0.0; points.len()],
            background: vec![0.0; self.background.len()],
            ..PointLoss::default()
        };
        let background = owner.iter().filter(|o| o.is_none()).count().max(1) as f32;
        let present = counts.iter().filter(|n| **n > 0).count().max(1) as f32;
        for (i, owner) in owner.iter().enumerate() {
            let weight = match owner {
                Some(k) => 0.5 / (present * counts[*k] as f32),
                None => 0.5 / background,
            };
            self.association(points, i, *owner, &means, held_out, weight, &mut loss);
            if let Some(k) = owner {
                let (phi, mean) = (row(points, i), row(&means, *k));
                let far = (squared(phi, mean).sqrt() - PULL_WITHIN).max(0.0);
                loss.value += f64::from(weight * far * far);
                let scale = 2.0 * weight * far / squared(phi, mean).sqrt().max(1e-6);
                let d = &mut loss.embedding[i * WIDTH..][..WIDTH];
                d.iter_mut()
                    .zip(phi.iter().zip(mean))
                    .for_each(|(d, (p, m))| *d += scale * (p - m));
            }
        }
        push(owner, &means, &counts, &mut loss);
        loss
    }

    fn association(
        &self,
        points: &[f32],
        i: usize,
        owner: Option<usize>,
        means: &[f32],
        held_out: &[bool],
        weight: f32,
        loss: &mut PointLoss,
    ) {
        let phi = row(points, i);
        let has_prototype = |k: &usize| !held_out[*k];
        let used: Vec<usize> = (0..held_out.len()).filter(has_prototype).collect();
        let prototypes = used
            .iter()
            .map(|k| row(means, *k))
            .chain(self.background.chunks_exact(WIDTH));
        let prototypes: Vec<&[f32]> = prototypes.collect();
        let mut logits: Vec<f32> = prototypes.iter().map(|m| -squared(phi, m) / 2.0).collect();
        logits.push(self.unknown);
        let last = logits.len() - 1;
        let is_target = |at: usize| match owner {
            None => at >= used.len() && at < last,
            Some(k) if held_out[k] => at == last,
            Some(k) => at < used.len() && used[at] == k,
        };
        let most = logits.iter().copied().fold(f32::MIN, f32::max);
        let e: Vec<f32> = logits.iter().map(|l| (l - most).exp()).collect();
        let sum: f32 = e.iter().sum();
        let wanted: f32 = e
            .iter()
            .enumerate()
            .filter(|(at, _)| is_target(*at))
            .map(|(_, e)| e)
            .sum();
        let wanted = wanted.max(1e-30);
        loss.value += f64::from(weight * (sum / wanted).ln());
        for (at, e) in e.iter().enumerate() {
            let own = if is_target(at) { e / wanted } else { 0.0 };
            let d = weight * (e / sum - own);
            if at == last {
                loss.unknown += d;
                continue;
            }
            for c in 0..WIDTH {
                let off = phi[c] - prototypes[at][c];
                loss.embedding[i * WIDTH + c] -= d * off;
                if at >= used.len() {
                    loss.background[(at - used.len()) * WIDTH + c] += d * off;
                }
            }
        }
    }

    /// Into a model's weights.
    pub fn write(&self, weights: &mut WeightSet) {
        let name = |part: &str| format!("{BASELINE}osis.{part}");
        let count = self.mlp.parameters.len();
        weights.insert(name("mlp"), vec![count], self.mlp.parameters.clone());
        weights.insert(
            name("background"),
            vec![BACKGROUNDS, WIDTH],
            self.background.clone(),
        );
        weights.insert(name("unknown"), vec![1], vec![self.unknown]);
    }

    /// From a model's weights; `None` where they are not there or of other sizes.
    pub fn read(weights: &WeightSet, channels: usize) -> Option<PointEmbedding> {
        let mut embedding = PointEmbedding::new(channels, 0);
        let find = |part: &str, count: usize| {
            let tensor = weights.find(&format!("{BASELINE}osis.{part}"))?;
            (tensor.data.len() == count).then(|| tensor.data.clone())
        };
        embedding.mlp.parameters = find("mlp", embedding.mlp.parameters.len())?;
        embedding.background = find("background", embedding.background.len())?;
        embedding.unknown = find("unknown", 1)?[0];
        Some(embedding)
    }
}

fn row(values: &[f32], i: usize) -> &[f32] {
    &values[i * WIDTH..][..WIDTH]
}

/// Mean embedding of each instance, and its points.
pub fn means(points: &[f32], owner: &[Option<usize>], instances: usize) -> (Vec<f32>, Vec<usize>) {
    let (mut means, mut counts) = (vec![0.0f32; instances * WIDTH], vec![0; instances]);
    for (i, k) in owner
        .iter()
        .enumerate()
        .filter_map(|(i, k)| Some((i, (*k)?)))
    {
        counts[k] += 1;
        let mean = &mut means[k * WIDTH..][..WIDTH];
        mean.iter_mut()
            .zip(row(points, i))
            .for_each(|(m, p)| *m += p);
    }
    for (mean, count) in means.chunks_exact_mut(WIDTH).zip(&counts) {
        mean.iter_mut().for_each(|m| *m /= (*count).max(1) as f32);
    }
    (means, counts)
}

/// Means of two instances nearer than [`PUSH_APART`] push each other's points away.
fn push(owner: &[Option<usize>], means: &[f32], counts: &[usize], loss: &mut PointLoss) {
    let present: Vec<usize> = (0..counts.len()).filter(|k| counts[*k] > 0).collect();
    let pairs = (present.len() * present.len().saturating_sub(1)).max(1) as f32;
    let mut gradient = vec![0.0f32; means.len()];
    for &a in &present {
        for &b in present.iter().filter(|b| **b != a) {
            let distance = squared(row(means, a), row(means, b)).sqrt();
            let near = (PUSH_APART - distance).max(0.0);
            loss.value += f64::from(near * near / pairs);
            let scale = -4.0 * near / (pairs * distance.max(1e-6));
            for c in 0..WIDTH {
                gradient[a * WIDTH + c] += scale * (means[a * WIDTH + c] - means[b * WIDTH + c]);
            }
        }
    }
    for (i, k) in owner
        .iter()
        .enumerate()
        .filter_map(|(i, k)| Some((i, (*k)?)))
    {
        for c in 0..WIDTH {
            loss.embedding[i * WIDTH + c] += gradient[k * WIDTH + c] / counts[k] as f32;
        }
    }
}

#[cfg(test)]
#[path = "embedding_tests.rs"]
mod tests;
