//! A synthetic scan to run before the first real scan: it touches the memory and brings code and weights into the caches.

use mluc_model::Manifest;

/// Beams and columns: as many points as a large sensor has.
const BEAMS: usize = 64;
const COLUMNS: usize = 1800;
/// Elevation of the lowest beam, as of a common 64-beam sensor, rad; the highest beam is level.
const LOWEST_RAD: f32 = -0.43;

/// Ground around the sensor, and walls at several distances for the beams that meet no ground inside the range.
pub(crate) fn scan(manifest: &Manifest) -> Vec<[f32; 4]> {
    let grid = &manifest.network.grid;
    let top_m = grid.range_max_m[2];
    let far_m = (0..2)
        .fold(0.0_f32, |far, axis| far.max(grid.range_max_m[axis]).max(-grid.range_min_m[axis]));
    let point = move |beam: usize, column: usize| {
        let down = LOWEST_RAD * (beam as f32 + 0.5) / BEAMS as f32;
        let around = std::f32::consts::TAU * column as f32 / COLUMNS as f32;
        let ground_m = manifest.sensor_height_m / -down.tan();
        // Twelve walls around the sensor, at 0.25 to 1 times the range.
        let wall_m = far_m * (0.25 + 0.75 * ((column * 12 / COLUMNS * 5 % 12) as f32 / 12.0));
        let range_m = ground_m.min(wall_m);
        let z = range_m * down.tan() + 0.02 * (column % 7) as f32;
        let (x, y) = (range_m * around.cos(), range_m * around.sin());
        [x, y, z.min(top_m - 0.01), 0.3]
    };
    let beam = |beam: usize| (0..COLUMNS).map(move |column| point(beam, column));
    (0..BEAMS).flat_map(beam).collect()
}
