//! The sensor's own motion where the source does not tell it: each scan is laid over an earlier one, seen from above.
//!
//! What stands upright (walls, trunks, parked cars) stands at the same place in both. A scan becomes a mean and a covariance for each tile of 1 m in which
//! something stands, and the motion is the one at which these lie best on those of the earlier scan (normal distributions transform, Biber and Strasser, IROS
//! 2003; distributions on distributions as Stoyanov et al., IJRR 2012). Few things move, so they hardly count. Height, roll and pitch play no part.

use mluc_geometry::ground::tiles::{NO_TILE, TILES, tile_of, tile_rows};
use mluc_ipc_types::EgoPose;
use nalgebra::{Isometry2, Matrix2, Matrix2x3, Matrix3, Vector2, Vector3};

use crate::FrameIndex;

/// Points of a tile that count, m above its lowest: neither ground nor ceiling; and how much their heights differ at one place (standard deviation) if they stand.
const HEIGHTS_M: [f32; 2] = [0.25, 2.5];
const STANDS_MIN_M: f64 = 0.15;
/// How far and how near is looked, m: nearer there may be the own body, which moves along.
const RANGE_M: [f64; 2] = [3.0, 50.0];
/// By how much places may differ, m, in each step of a match.
const SPREADS_M: [f64; 10] = [1.0, 0.8, 0.6, 0.45, 0.35, 0.25, 0.2, 0.15, 0.1, 0.1];
/// How far the motion may be from the last one, x, y (m) and yaw (rad), where the scans leave it open.
const CHANGE: [f64; 3] = [0.5, 0.5, 0.1];
/// Speeds that are tried while none is known, m a scan ahead.
const FIRST_STEPS_M: [f64; 4] = [0.0, 1.0, 2.0, 3.0];
/// Less agreement than this (the mean weight of the tiles, 0 to 1) is no match.
const AGREEMENT_MIN: f64 = 0.3;
/// The earlier scan is kept until the sensor is this far from it, m, rad; after more scans than this it is no use.
const KEPT_WITHIN: [f64; 2] = [2.0, 0.15];
const GAP_MAX: u64 = 10;

/// What stands in a tile.
#[derive(Clone, Copy, Debug)]
struct Upright {
    mean_m: Vector2<f64>,
    covariance: Matrix2<f64>,
}

/// Estimates the sensor's pose scan after scan; buffers are made once.
#[derive(Debug)]
pub struct EgoEstimator {
    /// Of the scan in hand and of the earlier one, with the place of each tile there.
    now: Vec<Upright>,
    earlier: Vec<Upright>,
    place: Vec<u32>,
    earlier_pose: Isometry2<f64>,
    /// The last scan's sequence and pose, and the motion of one scan before it, where known.
    last: Option<(u64, Isometry2<f64>)>,
    step: Option<Isometry2<f64>>,
}

impl Default for EgoEstimator {
    fn default() -> EgoEstimator {
        EgoEstimator {
            now: Vec::new(),
            earlier: Vec::new(),
            place: vec![NO_TILE; TILES],
            earlier_pose: Isometry2::identity(),
            last: None,
            step: None,
        }
    }
}

impl EgoEstimator {
    /// Where the sensor is, in the frame of the scan that it began with; None where the scan fits none before it: then the next one begins anew.
    pub fn estimate(&mut self, sequence: u64, scan: &FrameIndex) -> Option<EgoPose> {
        find_upright(scan, &mut self.now);
        let Some((last, pose)) = self.last else {
            self.begin(sequence, Isometry2::identity());
            return Some(told(&Isometry2::identity()));
        };
        let frames = sequence
            .checked_sub(last)
            .filter(|gap| (1..=GAP_MAX).contains(gap));
        let found = frames.and_then(|frames| {
            let steps = FIRST_STEPS_M.map(|x| Isometry2::translation(x, 0.0));
            let steps = self.step.map_or(steps.to_vec(), |step| vec![step]);
            let guesses = steps
                .iter()
                .map(|step| (0..frames).fold(pose, |pose, _| pose * step));
            let matches = guesses.map(|guess| self.lay(self.earlier_pose.inverse() * guess));
            matches
                .max_by(|a, b| a.0.total_cmp(&b.0))
                .filter(|(agreement, _)| *agreement >= AGREEMENT_MIN)
        });
        let Some((_, from_earlier)) = found else {
            (self.last, self.step) = (None, None);
            return None;
        };
        let found = self.earlier_pose * from_earlier;
        let share = 1.0 / frames.unwrap_or(1) as f64;
        self.step = Some(Isometry2::identity().lerp_slerp(&(pose.inverse() * found), share));
        let away = [
            from_earlier.translation.vector.norm(),
            from_earlier.rotation.angle().abs(),
        ];
        if away[0] > KEPT_WITHIN[0] || away[1] > KEPT_WITHIN[1] {
            self.begin(sequence, found);
        }
        self.last = Some((sequence, found));
        Some(told(&found))
    }

    /// Later scans are laid over the one in hand.
    fn begin(&mut self, sequence: u64, pose: Isometry2<f64>) {
        std::mem::swap(&mut self.now, &mut self.earlier);
        self.place.fill(NO_TILE);
        for (index, upright) in self.earlier.iter().enumerate() {
            self.place[tile(upright.mean_m)] = index as u32;
        }
        self.earlier_pose = pose;
        self.last = Some((sequence, pose));
    }

    /// Agreement and motion from the earlier scan to the one in hand, from a guess on.
    fn lay(&self, guess: Isometry2<f64>) -> (f64, Isometry2<f64>) {
        let [x, y, yaw] = CHANGE.map(|sd| sd.powi(-2));
        let prior = Matrix3::from_diagonal(&Vector3::new(x, y, yaw));
        let first = vector(&guess);
        let (mut at, mut agreement) = (first, 0.0);
        for spread_m in SPREADS_M {
            let motion = Isometry2::new(at.xy(), at.z);
            let turn = *motion.rotation.to_rotation_matrix().matrix();
            let (mut weights, mut curvature, mut slope) = (0.0, prior, prior * (first - at));
            for upright in &self.now {
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
                (weights, curvature, slope) = (
                    weights + weight,
                    curvature + weighted * moved,
                    slope + weighted * off,
                );
            }
            agreement = weights / self.now.len().max(1) as f64;
            at += curvature
                .try_inverse()
                .map_or(Vector3::zeros(), |inverse| inverse * slope);
        }
        (agreement, Isometry2::new(at.xy(), at.z))
    }

    /// The earlier scan's upright thing nearest to a place, in its tile or one beside it.
    fn nearest(&self, place: Vector2<f64>) -> Option<&Upright> {
        let tiles = tile_rows([place.x, place.y], 1.0).flatten();
        let there = tiles.filter_map(|tile| self.earlier.get(self.place[tile] as usize));
        let distance = |upright: &Upright| (upright.mean_m - place).norm_squared();
        there.min_by(|a, b| distance(a).total_cmp(&distance(b)))
    }
}

/// What stands in each tile: points whose heights do not follow from their places, as they do on slopes and roofs, and which hang not as high as a ceiling.
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
        let mean_m: Vector3<f64> = sum / count;
        let all = squares / count - mean_m * mean_m.transpose();
        let covariance: Matrix2<f64> = all.fixed_view::<2, 2>(0, 0).into();
        let follows = all.fixed_view::<2, 1>(0, 2);
        let rounded = (covariance + Matrix2::identity() * 1e-3).try_inverse();
        let stands = |inverse: Matrix2<f64>| {
            all.m33 - follows.dot(&(inverse * follows)) >= STANDS_MIN_M.powi(2)
        };
        if count >= 3.0 && mean_m.xy().norm() >= near_m && rounded.is_some_and(stands) {
            let mean_m = mean_m.xy();
            found.push(Upright { mean_m, covariance });
        }
    }
}

/// x, y, yaw.
fn vector(motion: &Isometry2<f64>) -> Vector3<f64> {
    motion.translation.vector.push(motion.rotation.angle())
}

fn tile(place: Vector2<f64>) -> usize {
    tile_of([place.x as f32, place.y as f32, 0.0]) as usize
}

fn told(pose: &Isometry2<f64>) -> EgoPose {
    let [x, y, yaw_rad] = vector(pose).into();
    EgoPose {
        position_m: [x, y, 0.0],
        yaw_rad,
        is_known: 1,
        reserved: 0,
    }
}

#[cfg(test)]
mod tests {
    use mluc_ipc_types::Point;

    use super::*;
    use crate::testing::sorted;

    /// A simulated scan that the program brings along, seen from a pose.
    fn seen_from(pose: &Isometry2<f64>) -> FrameIndex {
        let bytes = include_bytes!("../../mluc/assets/000380.scan");
        let mut scan = mluc_ingest::unpack(bytes).expect("a packed scan");
        for Point { x_m, y_m, .. } in &mut scan {
            let at = pose.inverse() * nalgebra::Point2::new(f64::from(*x_m), f64::from(*y_m));
            (*x_m, *y_m) = (at.x as f32, at.y as f32);
        }
        sorted(&scan)
    }

    #[test]
    fn a_drive_is_followed_also_over_lost_scans_and_a_stranger_begins_anew() {
        let mut estimator = EgoEstimator::default();
        let step = Isometry2::new(Vector2::new(1.3, 0.04), 0.03);
        let mut pose = Isometry2::identity();
        for sequence in 0..12 {
            if ![5, 6].contains(&sequence) {
                let found = estimator
                    .estimate(sequence, &seen_from(&pose))
                    .expect("a match");
                let [x, y, _] = found.position_m;
                let off = vector(&pose) - Vector3::new(x, y, found.yaw_rad);
                assert!(
                    off.xy().norm() < 0.1 && off.z.abs() < 0.005,
                    "{sequence}: {off}"
                );
            }
            pose *= step;
        }
        assert!(
            estimator.estimate(12, &sorted(&[])).is_none(),
            "nothing is there"
        );
        assert_eq!(
            estimator.estimate(13, &seen_from(&pose)),
            Some(told(&Isometry2::identity()))
        );
    }
}
