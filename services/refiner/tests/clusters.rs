//! The clusterer finds every cluster of a scene, and nothing of the ground.

mod common;

use common::{point, scan, sensor, standing};
use mluc_geometry::iou_3d;
use mluc_ipc_types::Point;
use mluc_refiner::{FrameClusterer, FrameClusters, Settings, clusters::NO_CLUSTER};

fn find(points: &[Point]) -> FrameClusters {
    let mut clusterer = FrameClusterer::new(&Settings::default(), &sensor()).expect("settings");
    let mut out = FrameClusters::default();
    // Runs twice: no data of a frame may stay for the next one.
    clusterer.find(&scan(&[standing(8.0, 3.0, [3.0, 2.0, 2.0], 0.5)]), &mut out);
    clusterer.find(points, &mut out);
    assert_sound(points, &out);
    out
}

/// No point is in two clusters; ranges, labels and boxes agree.
fn assert_sound(points: &[Point], out: &FrameClusters) {
    let mut seen = vec![false; points.len()];
    for (number, cluster) in out.clusters.iter().enumerate() {
        let own = out.points_of(cluster);
        assert!(own.len() >= 8 && own.is_sorted());
        assert_eq!(own.len() as u32, cluster.measures.points);
        for &index in own {
            assert!(!std::mem::replace(&mut seen[index as usize], true));
            assert_eq!(out.cluster_of_point[index as usize], number as u32);
        }
        assert!(cluster.shape.size_m.iter().all(|&side| side > 0.0));
        assert!((3..=16).contains(&cluster.footprint.count));
    }
    assert_eq!(out.cluster_of_point.len(), points.len());
    let has_none = out.cluster_of_point.iter().map(|&n| n == NO_CLUSTER);
    assert!(has_none.eq(seen.iter().map(|&s| !s)));
}

/// The number of clusters without a beam's returns on a roof, and without slivers of a face.
fn substantial(out: &FrameClusters) -> usize {
    let many = out.clusters.iter().filter(|c| c.measures.points >= 50);
    many.count()
}

#[test]
fn every_object_of_a_street_is_one_cluster() {
    let boxes = [
        standing(11.0, 4.0, [2.6, 1.25, 1.85], 1.1),
        standing(16.0, -6.0, [4.2, 1.8, 1.5], 0.3),
        standing(9.0, -1.5, [0.6, 0.6, 1.7], 0.0),
        standing(-12.0, 3.0, [4.1, 1.7, 1.5], 2.0),
        standing(-20.0, -8.0, [2.4, 1.1, 2.1], 0.9),
    ];
    let out = find(&scan(&boxes));
    assert_eq!(substantial(&out), boxes.len());
    for object in &boxes {
        let best = out.clusters.iter().map(|c| iou_3d(&c.shape, object));
        let best = best.fold(0.0, f64::max);
        assert!(best > 0.35, "{object:?}: {best}");
    }
}

#[test]
fn people_beside_each_other_are_told_apart_and_what_they_leave_is_too_few() {
    // The people are placed so that no ray hits a side of them.
    let people = [(0.0, 1.75), (0.87, 1.7)];
    let people = people.map(|(y, height)| standing(10.0, y, [0.5, 0.5, height], 0.0));
    let mut points = scan(&people);
    // These points are within the join distance of one person, but beyond half of it.
    points.extend([-1.0, -0.9, -0.8].map(|z| point([9.75, -0.65, z])));
    let out = find(&points);
    assert_eq!(substantial(&out), 2);
    assert!(out.cluster_of_point.ends_with(&[NO_CLUSTER; 3]));
}

#[test]
fn a_long_wall_is_cut_and_never_dropped() {
    let wall = standing(12.0, 0.0, [0.4, 50.0, 3.0], 0.0);
    let points = scan(&[wall]);
    let out = find(&points);
    assert!(out.clusters.iter().filter(|c| c.measures.is_cut).count() >= 3);
    let on_wall = |p: &Point| p.z_m > -1.73 + 0.3 && (p.x_m - 11.8).abs() < 0.1;
    for (p, &number) in points.iter().zip(&out.cluster_of_point) {
        assert!(!on_wall(p) || number != NO_CLUSTER, "{p:?}");
    }
    for cluster in &out.clusters {
        let m = &cluster.measures;
        // The limit is sixteen metres, and half a cell on either side.
        assert!(m.component_length_m > 30.0 && m.seen_m[0] <= 16.5, "{m:?}");
    }
}

#[test]
fn thousands_of_clusters_are_all_found() {
    // Columns of ten points, 2 m apart; the lowest point is on the ground.
    let column = |i: usize| {
        let [x, y] = [i / 10 % 72, i / 720].map(|k| 2.0 * k as f64 - 71.0);
        point([x, y, 0.2 * (i % 10) as f64 - common::SENSOR_HEIGHT_M])
    };
    let points: Vec<Point> = (0..72 * 720).map(column).collect();
    assert_eq!(find(&points).clusters.len(), 72 * 72);
}
