//! The sensor's own motion, if the source does not give it: each scan is matched to an earlier one, seen from above.
//!
//! Upright things (walls, trunks, parked cars) stand at the same place in both scans. Each tile of 1 m with upright points becomes a mean and a
//! covariance. The motion is the one that matches them best with the earlier scan (normal distributions transform, Biber and Strasser, IROS 2003;
//! distributions with distributions as Stoyanov et al., IJRR 2012). Few things move, so they hardly count. Height, roll and pitch are not used.

use crate::FrameIndex;
use mluc_geometry::ground::tiles::{NO_TILE, TILES, tile_of, tile_rows};
use mluc_ipc_types::{EgoPose, FrameHeader};
use nalgebra::{Isometry2, Matrix2, Matrix2x3, Matrix3, Vector2, Vector3};
use smart_default::SmartDefault;

/// Used heights above a tile's lowest point, m: neither ground nor ceiling; minimum standard deviation, m, of upright points' heights at one place.
const HEIGHTS_M: [f32; 2] = [0.25, 2.5];
const STANDS_MIN_M: f64 = 0.15;
/// Minimum and maximum range of used points, m: the robot's own body, which moves along, may be nearer.
const RANGE_M: [f64; 2] = [3.0, 50.0];
/// Allowed difference between places (standard deviation), m, in each step of a match.
const SPREADS_M: [f64; 10] = [1.0, 0.8, 0.6, 0.45, 0.35, 0.25, 0.2, 0.15, 0.1, 0.1];
/// Standard deviations of the change of motion, x, y (m) and yaw (rad): they count if the scans do not determine the motion.
const CHANGE: [f64; 3] = [0.5, 0.5, 0.1];
/// Speeds that are tried while none is known, m per scan along x (a sensor may face back); a later one must improve the agreement by `BETTER_BY`.
const FIRST_STEPS_M: [f64; 8] = [0.0, 1.0, -1.0, 2.0, -2.0, 3.0, -3.0, 4.0];
const BETTER_BY: f64 = 0.05;
/// Minimum agreement (mean weight of the tiles, 0 to 1) of a match.
const AGREEMENT_MIN: f64 = 0.3;
/// The earlier scan is replaced when the sensor is farther from it than this, m, rad, or after `KEPT_SCANS` scans: parked cars leave.
const KEPT_WITHIN: [f64; 2] = [2.0, 0.15];
const KEPT_SCANS: u64 = 20;
/// Maximum gap, in scans; after a longer one the estimate begins anew.
const GAP_MAX: u64 = 10;
/// Maximum number of scans in a row without the source's pose that its last motion bridges, if it gave the poses before.
const UNTOLD_MAX: u64 = 2;
/// [`EgoPose::is_known`] of a pose from the source and of an estimated pose: their frames of reference differ.
const TOLD: u32 = 1;
const ESTIMATED: u32 = 2;
/// Maximum number of a scan's tiles that are matched, which bounds the work.
const TILES_MAX: usize = 2000;

/// The upright points of a tile.
#[derive(Clone, Copy, Debug)]
struct Upright {
    mean_m: Vector2<f64>,
    covariance: Matrix2<f64>,
}

/// The pose at which a scan was taken.
#[derive(Clone, Copy, Debug)]
struct Taken {
    run: u64,
    sequence: u64,
    pose: Isometry2<f64>,
}

/// Estimates the sensor's pose for each scan; buffers are allocated once.
#[derive(Debug, SmartDefault)]
pub struct EgoEstimator {
    /// Tiles of the current scan and of the earlier one, and each tile's index there. Less than a quarter of all tiles lie within [`RANGE_M`].
    #[default(Vec::with_capacity(TILES / 4))]
    now: Vec<Upright>,
    #[default(Vec::with_capacity(TILES / 4))]
    earlier: Vec<Upright>,
    #[default(vec![NO_TILE; TILES])]
    place: Vec<u32>,
    earlier_taken: Option<Taken>,
    last: Option<Taken>,
    /// Whether the source gives the poses; the newest scan without a pose, and how many came since the last pose.
    is_told: bool,
    untold: (u64, u64),
    /// The motion per scan, from the last match or from the source's last poses.
    step: Option<Isometry2<f64>>,
    /// Whether the last scan did not match.
    has_missed: bool,
}

impl EgoEstimator {
    /// The sensor's pose: the source's, or one in a frame that is fixed while scans match. For a frame without its scan, and for a first mismatch,
    /// the last motion continues. `None` for the first scan, and for a second mismatch in a row: later scans are then matched to that scan.
    pub fn estimate(&mut self, header: &FrameHeader, scan: Option<&FrameIndex>) -> Option<EgoPose> {
        let (run, sequence) = (header.run_id, header.sequence);
        let known = self.last.filter(|last| last.run == run);
        let gap = known.and_then(|last| sequence.checked_sub(last.sequence));
        let gap = gap.filter(|gap| *gap <= GAP_MAX);
        let after = |step: &Isometry2<f64>| {
            let pose = known.map_or_else(Isometry2::identity, |last| last.pose);
            (0..gap.unwrap_or(0)).fold(pose, |pose, _| pose * step)
        };
        let taken = |pose| Taken { run, sequence, pose };
        let is_bridged = self.untold.0 == sequence || self.untold.1 < UNTOLD_MAX;
        if header.ego.is_known == TOLD {
            let [x, y, _] = header.ego.position_m;
            let pose = Isometry2::new(Vector2::new(x, y), header.ego.yaw_rad);
            if gap != Some(0) {
                let before = known.zip(gap).filter(|_| self.is_told);
                self.step = before.map(|(last, gap)| part(&last.pose, &pose, gap));
                (self.last, self.is_told) = (Some(taken(pose)), true);
                self.untold = (sequence, 0);
            }
            return Some(header.ego);
        } else if self.is_told && gap.is_some() && is_bridged {
            let is_new = u64::from(self.untold.0 != sequence);
            self.untold = (sequence, self.untold.1 + is_new);
            return self.step.map(|step| told(&after(&step), TOLD));
        } else if std::mem::take(&mut self.is_told) {
            (self.earlier_taken, self.last, self.step) = (None, None, None);
            return self.estimate(header, scan);
        }
        let (Some(scan), false) = (scan, gap == Some(0)) else {
            // The scan is gone, or the frame was sent again.
            return gap.and(self.step).map(|step| told(&after(&step), ESTIMATED));
        };
        find_upright(scan, &mut self.now);
        if let (Some(last), Some(gap), Some(earlier)) = (known, gap, self.earlier_taken)
            && let Some(pose) = self.matched(&earlier, after)
        {
            self.has_missed = false;
            self.step = Some(part(&last.pose, &pose, gap));
            self.last = Some(taken(pose));
            let away = earlier.pose.inverse() * pose;
            let away = [away.translation.vector.norm(), away.rotation.angle().abs()];
            let is_old = sequence - earlier.sequence > KEPT_SCANS;
            if is_old || away[0] > KEPT_WITHIN[0] || away[1] > KEPT_WITHIN[1] {
                self.begin(taken(pose));
            }
            return Some(told(&pose, ESTIMATED));
        }
        let is_second = std::mem::replace(&mut self.has_missed, true);
        if let (Some(step), false) = (gap.and(self.step), is_second) {
            let pose = after(&step);
            self.last = Some(taken(pose));
            return Some(told(&pose, ESTIMATED));
        }
        self.step = None;
        self.begin(taken(Isometry2::identity()));
        None
    }

    /// The pose of the current scan; the match starts where the last step, or each of the first steps, leads to.
    fn matched(
        &self,
        earlier: &Taken,
        after: impl Fn(&Isometry2<f64>) -> Isometry2<f64>,
    ) -> Option<Isometry2<f64>> {
        let first = FIRST_STEPS_M.map(|x| Isometry2::translation(x, 0.0));
        let steps = self.step.as_ref().map_or(&first[..], std::slice::from_ref);
        let mut best = (AGREEMENT_MIN - BETTER_BY, None);
        for step in steps {
            let (agreement, away) = self.lay(earlier.pose.inverse() * after(step));
            if agreement >= best.0 + BETTER_BY {
                best = (agreement, Some(earlier.pose * away));
            }
        }
        best.1
    }

    /// Later scans are matched to the current one.
    fn begin(&mut self, taken: Taken) {
        std::mem::swap(&mut self.now, &mut self.earlier);
        self.place.fill(NO_TILE);
        for (index, upright) in self.earlier.iter().enumerate() {
            self.place[tile(upright.mean_m)] = index as u32;
        }
        (self.earlier_taken, self.last) = (Some(taken), Some(taken));
    }

    /// Agreement and motion from the earlier scan to the current one, starting at a guess.
    fn lay(&self, guess: Isometry2<f64>) -> (f64, Isometry2<f64>) {
        let [x, y, yaw] = CHANGE.map(|sd| sd.powi(-2));
        let prior = Matrix3::from_diagonal(&Vector3::new(x, y, yaw));
        let first = vector(&guess);
        let stride = self.now.len().div_ceil(TILES_MAX).max(1);
        let (mut at, mut agreement) = (first, 0.0);
        for spread_m in SPREADS_M {
            let motion = Isometry2::new(at.xy(), at.z);
            let turn = *motion.rotation.to_rotation_matrix().matrix();
            let (mut weights, mut curvature, mut slope) = (0.0, prior, prior * (first - at));
            for upright in self.now.iter().step_by(stride) {
                let arm = turn * upright.mean_m;
                let place = arm + at.xy();
                let Some(other) = self.nearest(place) else {
                    continue;
                };
                let off = other.mean_m - place;
                let covariance = other.covariance + turn * upright.covariance * turn.transpose();
                let covariance = covariance + Matrix2::identity() * (spread_m * spread_m);
                let Some(information) = covariance.try_inverse() else {
                    continue;
                };
                let weight = (-0.5 * off.dot(&(information * off))).exp();
                let moved = Matrix2x3::new(1.0, 0.0, -arm.y, 0.0, 1.0, arm.x);
                let weighted = moved.transpose() * information * weight;
                weights += weight;
                curvature += weighted * moved;
                slope += weighted * off;
            }
            agreement = weights / self.now.len().div_ceil(stride).max(1) as f64;
            at += curvature.try_inverse().map_or(Vector3::zeros(), |inverse| inverse * slope);
        }
        (agreement, Isometry2::new(at.xy(), at.z))
    }

    /// The earlier scan's upright tile that is nearest to a place: this tile or a neighbouring one.
    fn nearest(&self, place: Vector2<f64>) -> Option<&Upright> {
        let tiles = tile_rows([place.x, place.y], 1.0).flatten();
        let there = tiles.filter_map(|tile| self.earlier.get(self.place[tile] as usize));
        let distance = |upright: &Upright| (upright.mean_m - place).norm_squared();
        there.min_by(|a, b| distance(a).total_cmp(&distance(b)))
    }
}

/// Finds the upright tiles: heights less than 2.5 m above the lowest that do not follow from the points' places, as they do on slopes and roofs.
fn find_upright(scan: &FrameIndex, found: &mut Vec<Upright>) {
    found.clear();
    let [near_m, far_m] = RANGE_M;
    for tile in tile_rows([0.0; 2], far_m).flatten() {
        let points = scan.points_in(tile).iter().map(|point| point.at_m);
        let low = points.clone().map(|[_, _, z]| z).fold(f32::MAX, f32::min);
        let heights = low + HEIGHTS_M[0]..low + HEIGHTS_M[1];
        let (mut count, mut sum, mut squares) = (0.0, Vector3::zeros(), Matrix3::zeros());
        for at_m in points.filter(|[_, _, z]| heights.contains(z)) {
            let at = Vector3::from(at_m.map(f64::from));
            (count, sum, squares) = (count + 1.0, sum + at, squares + at * at.transpose());
        }
        if count < 3.0 {
            continue;
        }
        let mean_m: Vector3<f64> = sum / count;
        let all = squares / count - mean_m * mean_m.transpose();
        let covariance: Matrix2<f64> = all.fixed_view::<2, 2>(0, 0).into();
        let follows = all.fixed_view::<2, 1>(0, 2);
        let rounded = (covariance + Matrix2::identity() * 1e-3).try_inverse();
        let stands = |inverse: Matrix2<f64>| {
            all.m33 - follows.dot(&(inverse * follows)) >= STANDS_MIN_M.powi(2)
        };
        if mean_m.xy().norm() >= near_m && rounded.is_some_and(stands) {
            let mean_m = mean_m.xy();
            found.push(Upright { mean_m, covariance });
        }
    }
}

/// The motion as x, y, yaw.
fn vector(motion: &Isometry2<f64>) -> Vector3<f64> {
    motion.translation.vector.push(motion.rotation.angle())
}

fn tile(place: Vector2<f64>) -> usize {
    tile_of([place.x as f32, place.y as f32, 0.0]) as usize
}

/// One of `steps` equal steps between two poses.
fn part(from: &Isometry2<f64>, to: &Isometry2<f64>, steps: u64) -> Isometry2<f64> {
    Isometry2::identity().lerp_slerp(&(from.inverse() * to), 1.0 / steps as f64)
}

fn told(pose: &Isometry2<f64>, is_known: u32) -> EgoPose {
    let [x, y, yaw_rad] = vector(pose).into();
    EgoPose::new([x, y, 0.0], yaw_rad, is_known)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{sorted, unpacked};
    use mluc_ipc_types::Point;

    /// A simulated scan that is bundled with the program, seen from a pose.
    fn seen_from(pose: &Isometry2<f64>) -> FrameIndex {
        let mut scan = unpacked(include_bytes!("../../mluc/assets/000380.bin.zst"));
        for Point { x_m, y_m, .. } in &mut scan {
            let at = pose.inverse() * nalgebra::Point2::new(f64::from(*x_m), f64::from(*y_m));
            (*x_m, *y_m) = (at.x as f32, at.y as f32);
        }
        sorted(&scan)
    }

    fn header(run_id: u64, sequence: u64) -> FrameHeader {
        FrameHeader { run_id, sequence, ..FrameHeader::default() }
    }

    #[test]
    fn a_drive_is_followed_over_lost_scans_and_what_does_not_match_begins_anew() {
        let mut estimator = EgoEstimator::default();
        let step = Isometry2::new(Vector2::new(1.3, 0.04), 0.03);
        let mut pose = Isometry2::identity();
        for sequence in 0..30 {
            let scan = seen_from(&pose);
            let found = match sequence {
                5 | 6 => None,
                9 => Some(estimator.estimate(&header(7, sequence), None)),
                _ => Some(estimator.estimate(&header(7, sequence), Some(&scan))),
            };
            if let (Some(found), 1..) = (found, sequence) {
                let found = found.expect("a match");
                let [x, y, _] = found.position_m;
                let found_pose = Isometry2::new(Vector2::new(x, y), found.yaw_rad);
                let off = vector(&(pose.inverse() * found_pose));
                assert!(off.xy().norm() < 0.1 && off.z.abs() < 0.005, "{sequence}: {off}");
                let again = estimator.estimate(&header(7, sequence), Some(&scan));
                assert!(sequence == 9 || again == Some(found), "sent again");
            }
            pose *= step;
        }
        let (scan, empty) = (seen_from(&pose), sorted(&[]));
        let mut is_told =
            |run, sequence, scan| estimator.estimate(&header(run, sequence), Some(scan)).is_some();
        assert!(is_told(7, 30, &empty), "the motion goes on");
        assert!(is_told(7, 31, &scan), "the scans before are still there");
        let twice = [32, 33].map(|sequence| is_told(7, sequence, &empty));
        assert_eq!(twice, [true, false], "twice is once too often");
        assert!(!is_told(7, 34, &scan) && is_told(7, 35, &scan));
        assert!(!is_told(8, 36, &scan), "another run");
    }

    #[test]
    fn poses_that_are_missing_now_and_then_and_lost_scans_are_bridged() {
        let mut estimator = EgoEstimator::default();
        for sequence in [0, 1, 2, 3, 5, 6, 7, 10, 11, 14, 15] {
            let (mut header, x_m) = (header(7, sequence), 1.5 * sequence as f64);
            if [0, 1, 3, 7, 11].contains(&sequence) {
                header.ego = EgoPose::new([x_m, 0.0, 0.0], 0.0, TOLD);
            }
            let found = estimator.estimate(&header, None).expect("a pose");
            let off_m = (found.position_m[0] - x_m).abs();
            assert!(off_m < 1e-9, "{sequence}: {found:?}");
        }
    }

    #[test]
    fn the_source_s_motion_goes_on_for_two_scans_that_it_does_not_tell() {
        let mut estimator = EgoEstimator::default();
        let empty = sorted(&[]);
        let found = [1, 1, 0, 0, 1, 0, 0, 0, 1].into_iter().enumerate();
        let found = found.map(|(at, is_known)| {
            let mut header = header(7, at as u64);
            header.ego.is_known = is_known;
            header.ego.position_m[0] = at as f64 * f64::from(is_known);
            estimator.estimate(&header, Some(&empty)).unwrap_or_default()
        });
        let found: Vec<_> = found.map(|ego| (ego.is_known, ego.position_m[0])).collect();
        let told = |at: u32| (TOLD, f64::from(at));
        let untold = (0, 0.0);
        let expected = [0, 1, 2, 3, 4, 5, 6].map(told);
        assert_eq!(found, [&expected[..], &[untold, told(8)]].concat());
    }
}
