//! The refiner's estimate of the sensor's motion from scans alone, on simulated drives with known poses.

use mluc_dataset::read_scan;
use mluc_ipc_types::FrameHeader;
use mluc_refiner::{EgoEstimator, FrameIndex};
use mluc_simulate::{ExportOptions, Family, Split, export};
use std::fs;

const DRIVES: u32 = 15;
/// The scans of one second, and the scan at its start.
const SCANS: usize = 11;

#[test]
fn the_motion_of_a_second_is_known_to_centimetres_by_one_sensor() {
    is_known_to_centimetres(Family::SimKitti);
}

#[test]
fn the_motion_of_a_second_is_known_to_centimetres_by_any_sensor() {
    is_known_to_centimetres(Family::SimAny);
}

fn is_known_to_centimetres(family: Family) {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("drives");
    let count = DRIVES * SCANS as u32;
    let mut options = ExportOptions::new(family, Split::Val, count, 1, out.clone());
    options.sequence = Some(SCANS as u32);
    export(&options, || ()).expect("simulated drives");
    let text = fs::read_to_string(out.join("poses.txt")).expect("poses");
    let lines = text.lines().filter(|line| !line.starts_with('#'));
    let poses = lines.map(|line| line.split(' ').map(|v| v.parse().expect("a number")));
    let poses: Vec<Vec<f64>> = poses.map(Iterator::collect).collect();
    let (mut frame, mut lost) = (FrameIndex::default(), 0);
    let (mut places_m, mut headings_rad) = (vec![], vec![]);
    for first in (0..poses.len()).step_by(SCANS) {
        let mut estimator = EgoEstimator::default();
        let mut last = None;
        for index in first..first + SCANS {
            let path = out.join(format!("velodyne/{index:06}.bin"));
            let scan = read_scan(&path).expect("a scan");
            frame.sort(bytemuck::cast_slice(&scan));
            let sequence = (index - first) as u64;
            let header = FrameHeader::new(sequence, "");
            last = estimator.estimate(&header, Some(&frame));
            lost += u32::from(last.is_none() && sequence > 0);
        }
        // The estimate begins at 0; the simulator's drives do not turn.
        let [begin, end] = [&poses[first], &poses[first + SCANS - 1]];
        let Some(found) = last else { continue };
        let [x, y] = [0, 1].map(|axis| found.position_m[axis] - (end[axis] - begin[axis]));
        places_m.push(x.hypot(y));
        headings_rad.push((found.yaw_rad - (end[3] - begin[3])).abs());
    }
    let name = family.name();
    let at = |values: &[f64], q| mluc_geometry::quantile_of(values.to_vec(), q).expect("some");
    let [place_m, most_m] = [0.5, 0.9].map(|q| at(&places_m, q));
    let heading_rad = at(&headings_rad, 0.5);
    println!(
        "{name}: after 1 s {place_m:.3} m (p90 {most_m:.3}), {heading_rad:.4} rad, {lost} of {count} scans lost"
    );
    assert!(place_m < 0.1 && most_m < 0.3, "{name}: {places_m:?}");
    assert!(heading_rad < 0.002 && lost < 5, "{name}: {headings_rad:?}");
}
