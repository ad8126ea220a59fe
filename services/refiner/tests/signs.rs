//! Compares the printed sign of the angle with the original one, on a wall with a step in depth.

mod common;

use mluc_refiner::paper::Neighbourhood;
use mluc_refiner::paper::grow::{Depth, Grower, Growth, Printed};

/// Two parallel walls, seen frontally: the left half is at 10 m, the right half `step_m` behind it.
fn step(step_m: f64) -> (Neighbourhood, Vec<bool>) {
    let mut around = Neighbourhood::default();
    around.origin_m = [10.0, 0.0];
    let mut is_near = Vec::new();
    for elevation in common::elevations_rad() {
        for column in -160..160 {
            let azimuth = (f64::from(column) + 0.5) * std::f64::consts::TAU / 1024.0 / 4.0;
            let x = if column >= 0 { 10.0 } else { 10.0 + step_m };
            let (y, z) = (x * azimuth.tan(), x / azimuth.cos() * elevation.tan());
            around.x_m.push((x - 10.0) as f32);
            around.y_m.push(y as f32);
            around.z_m.push(z as f32);
            around.height_m.push((z + 5.0) as f32);
            around.index.push(is_near.len() as u32);
            is_near.push(column >= 0);
        }
    }
    (around, is_near)
}

/// Shares of the near wall and of the far wall in the cluster of a point on the near wall, next to the step.
fn shares(grower: &mut dyn Grower, step_m: f64) -> [f64; 2] {
    let (around, is_near) = step(step_m);
    let off = |i: &usize| around.y_m[*i].abs() + around.z_m[*i].abs();
    let near = (0..is_near.len()).filter(|&i| is_near[i]);
    let seed = near.min_by(|a, b| off(a).total_cmp(&off(b))).expect("a point");
    let mut members = Vec::new();
    let growth = Growth { around: &around, seed, height_min_m: f64::NEG_INFINITY };
    grower.grow(&growth, &mut members);
    [true, false].map(|side| {
        let all = is_near.iter().filter(|&&near| near == side).count();
        members.iter().filter(|&&m| is_near[m as usize] == side).count() as f64 / all as f64
    })
}

#[test]
fn the_corrected_sign_keeps_the_surface_and_stops_at_the_step() {
    let sensor = common::sensor();
    let fine = mluc_model::Beams {
        azimuth_step_rad: std::f32::consts::TAU / 4096.0,
        ..sensor.beams.expect("beams")
    };
    let mut depth = Depth::new(Some(&fine));
    let [near, far] = shares(&mut depth, 1.5);
    assert_eq!((near, far), (1.0, 0.0));
}

#[test]
fn the_printed_sign_splits_the_surface_and_jumps_over_the_step() {
    let mut printed = Printed::default();
    // The step is within the method's neighbour distance of 0.5 m.
    let [near, far] = shares(&mut printed, 0.4);
    assert!(near < 0.5, "most of its own surface is left out: {near}");
    assert!(far > 0.0, "and it goes on behind the step: {far}");
}
