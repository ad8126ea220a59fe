//! The point embedding's loss falls, and its parts are what they say.

use super::*;
use crate::optimizer::Adam;
use mluc_model::{Grid, Network};

const CHANNELS: usize = 5;

/// Points of `instances` blobs in feature space, and background.
fn points(seed: u64, instances: usize) -> (Vec<f32>, Vec<Option<usize>>) {
    let mut random = Random::new(seed, &[1]);
    let (mut rows, mut owner) = (vec![], vec![]);
    for i in 0..40 * (instances + 1) {
        let k = i % (instances + 1);
        owner.push((k < instances).then_some(k));
        let center = [k as f64, (k * k % 3) as f64, -(k as f64)];
        let mut value = |c: usize| (center[c % 3] + 0.1 * random.normal()) as f32;
        rows.extend((0..CHANNELS + GEOMETRY).map(&mut value));
    }
    (rows, owner)
}

#[test]
fn points_of_an_instance_come_together_and_held_out_ones_become_unknown() {
    let mut embedding = PointEmbedding::new(CHANNELS, 3);
    let mut adam = Adam::new(embedding.mlp.parameters.len());
    let (rows, owner) = points(1, 3);
    let mut values = vec![];
    for step in 0..300 {
        // The last instance has no prototype half of the time.
        let held_out = [false, false, step % 2 == 0];
        let (value, gradient) = embedding.step(rows.clone(), &owner, &held_out);
        values.push(value);
        adam.step(&mut embedding.mlp.parameters, &gradient, (0.01, 0.9));
    }
    let (first, last) = (values[0], values[299]);
    assert!(last < 0.3 * first, "{first} to {last}");
    let trace = embedding.mlp.forward(rows);
    let (means, _) = means(trace.output(), &owner, 3);
    for (i, owner) in owner.iter().enumerate().take(30) {
        let phi = row(trace.output(), i);
        let p = embedding.associate(phi, &means);
        assert!((p.iter().sum::<f32>() - 1.0).abs() < 1e-5);
        let best = (0..p.len()).fold(0, |a, b| if p[b] > p[a] { b } else { a });
        assert_eq!(best, owner.unwrap_or(3));
        // Without its prototype the last one's points are of nobody.
        let p = embedding.associate(phi, &means[..2 * WIDTH]);
        let is_unknown = p[3] > p[0].max(p[1]) && p[3] > p[2];
        assert!(*owner != Some(2) || is_unknown, "{p:?}");
    }
}

#[test]
fn a_point_takes_the_features_of_its_cell() {
    let manifest = Manifest::untrained("kitti", Network::compact(Grid::kitti_compact(), 3));
    let channels = manifest.network.feature_channels();
    let [_, columns] = manifest.network.map_shape();
    let rows: Vec<f32> = (0..channels).map(|c| c as f32).collect();
    let cells = [(100 * columns + 20) as u32];
    let features = FrameFeatures::new(&manifest, &cells, &rows);
    let mut found = vec![];
    // 0.4 m cells from x 0 and y -40.
    assert!(features.append([8.1, 0.3, -0.73], &mut found));
    let (found_rows, geometry) = found.split_at(channels);
    assert_eq!(found_rows, rows);
    let mut pairs = geometry.iter().zip([0.5, -0.25, 0.25]);
    assert!(pairs.all(|(a, b)| (a - b).abs() < 1e-3), "{geometry:?}");
    assert!(!features.append([-1.0, 0.0, 0.0], &mut found));
}
