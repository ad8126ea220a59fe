//! DBSCAN (Ester et al., 1996) on 3D points and, where they have one, on their embedding, with a grid whose cell length is the reach in space.

use std::collections::BTreeMap;

/// Points of a cluster, by index, ascending.
pub(super) type Group = Vec<usize>;

/// Reach of a point, m (equals coordinates divided by 0.7 with a reach of 1).
const REACH_M: f32 = 0.7;
/// Reach of an embedding.
const REACH_EMBEDDING: f32 = 0.5;

/// Clusters in the order of their first points. A point with at least `core_min` points within its reach, including itself, is
/// a core; cores within each other's reach, and points within the reach of a core, are one cluster.
/// `embeddings`: one per point, all of the same length, which may be 0.
pub(super) fn cluster(points_m: &[[f32; 3]], embeddings: &[&[f32]], core_min: usize) -> Vec<Group> {
    let cell = |p: &[f32; 3]| p.map(|v| (v / REACH_M).floor() as i32);
    let mut cells: BTreeMap<[i32; 3], Vec<usize>> = BTreeMap::new();
    for (i, p) in points_m.iter().enumerate() {
        cells.entry(cell(p)).or_default().push(i);
    }
    let near = |i: usize, found: &mut Vec<usize>| {
        found.clear();
        let (p, [x, y, z]) = (points_m[i], cell(&points_m[i]));
        for cx in x - 1..=x + 1 {
            for cy in y - 1..=y + 1 {
                let range = cells.range([cx, cy, z - 1]..=[cx, cy, z + 1]);
                let within = |j: &&usize| {
                    let d = [0, 1, 2].map(|k| points_m[**j][k] - p[k]);
                    let place = d.iter().map(|d| d * d).sum::<f32>() / (REACH_M * REACH_M);
                    let pairs = embeddings[i].iter().zip(embeddings[**j]);
                    let apart = pairs.map(|(a, b)| (a - b).powi(2)).sum::<f32>();
                    place + apart / (REACH_EMBEDDING * REACH_EMBEDDING) <= 1.0
                };
                found.extend(range.flat_map(|(_, members)| members.iter().filter(within)));
            }
        }
    };
    let mut seen = vec![false; points_m.len()];
    let (mut groups, mut around) = (vec![], vec![]);
    for first in 0..points_m.len() {
        if seen[first] {
            continue;
        }
        near(first, &mut around);
        if around.len() < core_min {
            continue;
        }
        let mut group = vec![];
        let mut queue = vec![first];
        seen[first] = true;
        while let Some(i) = queue.pop() {
            group.push(i);
            near(i, &mut around);
            if around.len() < core_min {
                continue;
            }
            for &j in &around {
                if !std::mem::replace(&mut seen[j], true) {
                    queue.push(j);
                }
            }
        }
        group.sort_unstable();
        groups.push(group);
    }
    groups
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blobs_are_clusters_and_strays_are_none() {
        let line = |x: f32, n: usize| (0..n).map(move |i| [x + 0.3 * i as f32, 0.0, 0.0]);
        let mut points: Vec<[f32; 3]> = line(0.0, 8).collect();
        points.extend(line(10.0, 6));
        points.push([5.0, 5.0, 0.0]);
        let plain: Vec<&[f32]> = vec![&[]; points.len()];
        let groups = cluster(&points, &plain, 4);
        assert_eq!(groups, [(0..8).collect::<Vec<_>>(), (8..14).collect()]);
        assert!(cluster(&points, &plain, 9).is_empty());
        assert!(cluster(&[], &[], 1).is_empty());
        // Two halves of the first line that differ in their embedding.
        let embedding: fn(usize) -> &'static [f32] = |i| if i < 4 { &[0.0] } else { &[2.0] };
        let apart: Vec<&[f32]> = (0..points.len()).map(embedding).collect();
        let halves = [(0..4).collect::<Vec<_>>(), (4..8).collect()];
        assert_eq!(cluster(&points, &apart, 3)[..2], halves);
    }
}
