//! Number of the sensor's beams that hit an object.
//!
//! Scan files do not say which beam a point belongs to. The points of one beam have one elevation, seen from the sensor, so the
//! points in a box are sorted by elevation and split where two of them are further apart than a share of the distance between
//! the scan's beams. Not supported: sensors tilted by more than a degree against the axes of the scan, and merged scans; their beams have no single elevation.

use crate::LabelledFrame;
use mluc_dataset::Label;
use mluc_geometry::{Box3, Calibration, Inside, quantile_of};
use mluc_ingest::estimate::Estimator;
use mluc_ipc_types::{POINTS_MAX, Point};

/// Share of the distance between beams: larger than the variation of a beam within an object, smaller than the distance to the next beam.
const GAP_SHARE: f64 = 0.25;
/// Real sensors have denser beams near the horizon: the reference distance is this quantile of the gaps between neighbouring beams.
const CLOSE_SHARE: f64 = 0.1;
/// Assumed distance where the beams cannot be estimated, degrees.
const GAP_DEG: f64 = 0.1;

/// Number of rings on each box of a frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameRings {
    /// Rings on the labels, in their order.
    pub labels: Vec<usize>,
    /// Rings on the detections, in their order.
    pub detections: Vec<usize>,
}

impl FrameRings {
    /// Counts the rings of `points` (m, sensor frame; all finite) on every box of the frame.
    pub fn of(frame: &LabelledFrame, calibration: &Calibration, points: &[Point]) -> FrameRings {
        let gap_deg = gap_deg(points);
        let count = |label: &Label| {
            let shape = calibration.box_in_sensor_from_label(&label.camera_box);
            count_rings(&shape, points, gap_deg)
        };
        FrameRings {
            labels: frame.labels.iter().map(count).collect(),
            detections: frame.detections.iter().map(count).collect(),
        }
    }
}

/// Two points further apart in elevation than this belong to two beams, degrees.
fn gap_deg(points: &[Point]) -> f64 {
    let mut estimator = Estimator::new();
    estimator.look(points, 0);
    let beams = &estimator.estimate().elevations_deg;
    let gaps = beams.windows(2).map(|pair| f64::from(pair[0] - pair[1]));
    let close = quantile_of(gaps.collect(), CLOSE_SHARE);
    close.map_or(GAP_DEG, |close| GAP_SHARE * close)
}

/// Number of beams with a point in the box.
fn count_rings(shape: &Box3, points: &[Point], gap_deg: f64) -> usize {
    let (inside, reach_m) = (Inside::of(shape, 0.0), shape.half_diagonal_m());
    let [x, y, _] = shape.center_m;
    let place = |p: &Point| [p.x_m, p.y_m, p.z_m].map(f64::from);
    let near = points.iter().map(place).filter(|p| {
        // The square around the footprint excludes most points.
        (p[0] - x).abs() <= reach_m && (p[1] - y).abs() <= reach_m && inside.contains(*p)
    });
    let elevation_deg = |[x, y, z]: [f64; 3]| z.atan2(x.hypot(y)).to_degrees();
    let mut elevations: Vec<f64> = near.map(elevation_deg).collect();
    elevations.sort_unstable_by(f64::total_cmp);
    let cuts = elevations.windows(2).filter(|w| w[1] - w[0] > gap_deg);
    cuts.count() + usize::from(!elevations.is_empty())
}

pub(crate) fn finite_points(scan: &[[f32; 4]]) -> Vec<Point> {
    bytemuck::cast_slice(scan).iter().copied().filter(Point::is_finite).take(POINTS_MAX).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use mluc_model::SensorProfile;
    use mluc_simulate::{Family, Split, frame};
    use std::f32::consts::PI;

    /// The beam of each point: a simulated scan is ordered by beam, each beam counter-clockwise from ahead.
    fn beams(points: &[[f32; 4]]) -> Vec<usize> {
        let mut beam = 0;
        let mut before = 0.0;
        let mut next = |&[x, y, ..]: &[f32; 4]| {
            let azimuth = y.atan2(x).rem_euclid(2.0 * PI);
            beam += usize::from(azimuth < before - PI / 4.0);
            before = azimuth;
            beam
        };
        points.iter().map(&mut next).collect()
    }

    #[test]
    fn rings_are_the_beams_that_hit() {
        // Sensors with beams at least a third of a degree apart: the simulator varies a beam by 0.12 degrees, more than any real sensor.
        for name in ["vlp-16", "hdl-32e", "vlp-32c", "os1-64"] {
            let mut sensor = SensorProfile::load(name).expect("a product");
            (sensor.height_m, sensor.azimuth_step_deg) = (Some(1.6), 0.4);
            // Each beam then starts straight ahead.
            sensor.azimuth_offsets_deg.clear();
            let (mut objects, mut exact, mut off) = (0, 0, 0);
            for index in 0..8 {
                let frame = frame(Family::SimAny, Split::Val, 5, index, Some(&sensor));
                let frame = frame.expect("a frame");
                let beams = beams(&frame.points);
                let points: Vec<Point> = bytemuck::cast_slice(&frame.points).to_vec();
                let gap_deg = gap_deg(&points);
                for object in &frame.objects {
                    let shape = object.box_in_sensor;
                    let hits = frame.points.iter().zip(&beams).filter(|(p, _)| shape.has_point(p));
                    let mut hits: Vec<usize> = hits.map(|(_, beam)| *beam).collect();
                    hits.dedup();
                    let found = count_rings(&shape, &points, gap_deg);
                    objects += 1;
                    exact += usize::from(found == hits.len());
                    off += found.abs_diff(hits.len());
                }
            }
            let share = exact as f64 / objects as f64;
            let is_close = share > 0.82 && off * 5 < objects;
            assert!(is_close, "{name}: {exact} of {objects}, {off} rings off");
        }
    }
}
