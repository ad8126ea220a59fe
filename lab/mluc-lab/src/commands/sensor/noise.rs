//! Range noise of a sensor: the residuals of a parabola fitted to neighbouring returns of a beam.

use mluc_ingest::estimate::SensorEstimate;
use mluc_ipc_types::Point;
use nalgebra::{SMatrix, SVector};

/// Number of neighbouring returns of one beam in a fit.
const WINDOW: usize = 8;
/// Azimuth step between two of them, degrees; and the maximum difference of their elevations.
const GAP_DEG: std::ops::Range<f32> = 0.02..1.0;
const ONE_BEAM_DEG: f32 = 0.15;
/// Ranges where a beam has enough returns of one surface, m.
const RANGES_M: std::ops::Range<f32> = 3.0..40.0;
/// Share of the windows that count as smooth, and the share of the noise in their last window (chi distribution with 8 - 3 = 5 degrees of freedom).
const SMOOTH_SHARE: f64 = 0.2;
const LEFT_SHARE: f64 = 0.6845;
/// Minimum number of windows for an estimate; a guess.
const WINDOWS_MIN: usize = 300;

/// Azimuth, elevation (degrees) and range (m) of a return.
type Return = [f32; 3];

/// Standard deviation of a range, m. Returns of one beam are consecutive in the scan, or are sorted where its beams are clear; `None` with few windows.
pub(super) fn range_noise_m(scans: &[Vec<Point>], found: &SensorEstimate) -> Option<f32> {
    let mut left_m: Vec<f64> = Vec::new();
    for points in scans {
        let returns = points.iter().map(|point| {
            let [x, y, z] = [point.x_m, point.y_m, point.z_m];
            let range_m = x.hypot(y).hypot(z);
            let [azimuth, elevation] = [y.atan2(x), (z / range_m).asin()].map(f32::to_degrees);
            [azimuth, elevation, range_m]
        });
        let mut returns: Vec<Return> = returns.filter(|r| RANGES_M.contains(&r[2])).collect();
        if found.are_beams_clear {
            let beams = found.elevations_deg.windows(2);
            let middles: Vec<f32> = beams.map(|pair| (pair[0] + pair[1]) / 2.0).collect();
            let beam = |r: &Return| middles.partition_point(|middle| *middle > r[1]);
            // Sorted by beam and by ten-thousandths of a degree.
            returns.sort_by_cached_key(|r| (beam(r), (r[0] * 1e4) as i32));
        }
        left_m.extend(returns.as_chunks().0.iter().filter_map(left_over_m));
    }
    if left_m.len() < WINDOWS_MIN {
        return None;
    }
    let smooth = (left_m.len() as f64 * SMOOTH_SHARE) as usize;
    let (_, left_m, _) = left_m.select_nth_unstable_by(smooth, f64::total_cmp);
    Some((*left_m / LEFT_SHARE) as f32)
}

/// Residual of a parabola through their ranges, m; `None` where the returns are not neighbours on one beam.
fn left_over_m(returns: &[Return; WINDOW]) -> Option<f64> {
    let steps = returns.windows(2).map(|pair| pair[1][0] - pair[0][0]);
    let turns_left = returns[1][0] > returns[0][0];
    let mut steps = steps.map(|step| if turns_left { step } else { -step });
    let elevations = returns.map(|r| r[1]);
    let [low, high] = [f32::min, f32::max].map(|of| elevations.into_iter().fold(elevations[0], of));
    if !steps.all(|step| GAP_DEG.contains(&step)) || high - low > ONE_BEAM_DEG {
        return None;
    }
    let middle = (returns[0][0] + returns[WINDOW - 1][0]) / 2.0;
    let at = |row: usize, power| f64::from(returns[row][0] - middle).powi(power as i32);
    let surface = SMatrix::<f64, WINDOW, 3>::from_fn(at).qr().q();
    let ranges = SVector::<f64, WINDOW>::from_fn(|row, _| f64::from(returns[row][2]));
    let left = ranges - surface * (surface.transpose() * ranges);
    Some((left.norm_squared() / (WINDOW - 3) as f64).sqrt())
}
