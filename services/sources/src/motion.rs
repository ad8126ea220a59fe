//! The sensor's motion during a turn: its poses by time, from odometry or transforms, and the correction of a scan's points for it.

use crate::files::{Cloud, Layout, Reader};
use crate::{Deskew, Scan, SourceError};
use mluc_ipc_types::{EgoPose, Flags};
use nalgebra::{IsometryMatrix3, Quaternion, Rotation3, Translation3, UnitQuaternion};
use std::{array::from_fn, collections::BTreeMap};

/// Type of transforms in ROS 2. Messages with poses are in CDR.
pub const TRANSFORMS: &str = "tf2_msgs/msg/TFMessage";
/// The usual ROS topics of transforms: changing ones, fixed ones.
pub const TF: [&str; 2] = ["/tf", "/tf_static"];
const POSE: &str = "geometry_msgs/msg/PoseStamped";
/// Type of odometry in ROS 2.
pub const ODOMETRY: &str = "nav_msgs/msg/Odometry";
/// All message types with poses.
pub(crate) const POSES: [&str; 3] = [ODOMETRY, POSE, TRANSFORMS];
/// Number of poses that are kept per frame (up to twice as many): one second at the highest rate of any odometry.
const POSES_MAX: usize = 500;
/// Number of frames that are kept; robots have about a hundred.
const FRAMES_MAX: usize = 256;
/// Two poses farther apart (s), or with a higher speed between them, are no motion: there is a gap, or the robot was localized anew.
const GAP_MAX_S: f64 = 1.0;
const SPEED_MAX_MPS: f64 = 100.0;
/// How long the motion between the two nearest poses is extrapolated, s.
const BEYOND_MAX_S: f64 = 0.2;
/// Shortest span of the times of a turn's points, and largest difference between these times and the stamp, s.
const TURN_S: [f64; 2] = [0.001, 1.0];
/// Times above this value count since 1970, ns.
const SINCE_1970_NS: f64 = 1e17;

/// Pose of a sensor, or of a frame in its parent.
type Pose = IsometryMatrix3<f64>;

pub(crate) const NO_TIMES: &str = "the points have no times (a field t, time or timestamp)";

/// The poses of a frame by time.
#[derive(Default)]
pub(crate) struct Trajectory {
    poses: Vec<(u64, Pose)>,
    is_fixed: bool,
}

impl Trajectory {
    /// Adds a pose; poses come in the order of their stamps. A late pose is left out. A step back of more than a second clears the earlier poses.
    pub(crate) fn push(&mut self, stamp_ns: u64, pose: Pose) {
        if let Some((last_ns, _)) = self.poses.last() {
            if seconds(stamp_ns, *last_ns) < -GAP_MAX_S {
                self.poses.clear();
            } else if stamp_ns <= *last_ns && !self.is_fixed {
                return;
            }
        }
        if self.poses.len() >= 2 * POSES_MAX {
            self.poses.drain(..POSES_MAX);
        }
        self.poses.push((stamp_ns, pose));
    }

    /// The pose at a time, interpolated between the poses before and after it, or extrapolated from the nearest two. `None`: no poses are near.
    pub(crate) fn at(&self, stamp_ns: u64, after_s: f64) -> Option<Pose> {
        if self.is_fixed {
            return self.poses.last().map(|(_, pose)| *pose);
        }
        let time_s = |pose: &(u64, _)| seconds(pose.0, stamp_ns) - after_s;
        let pairs = self.poses.windows(2).filter_map(|pair| {
            let (from_s, to_s) = (time_s(&pair[0]), time_s(&pair[1]));
            let way_m = (pair[1].1.translation.vector - pair[0].1.translation.vector).norm();
            let span_s = to_s - from_s;
            let is_motion = span_s > 0.0 && span_s <= GAP_MAX_S && way_m <= SPEED_MAX_MPS * span_s;
            let beyond_s = from_s.max(-to_s).max(0.0);
            (is_motion && beyond_s <= BEYOND_MAX_S).then_some((beyond_s, -from_s / span_s, pair))
        });
        let (_, share, pair) = pairs.min_by(|a, b| a.0.total_cmp(&b.0))?;
        pair[0].1.try_lerp_slerp(&pair[1].1, share, 1e-9)
    }
}

fn seconds(stamp_ns: u64, since_ns: u64) -> f64 {
    stamp_ns.wrapping_sub(since_ns) as i64 as f64 * 1e-9
}

/// Poses of a robot's frames, from messages of odometry and transforms.
pub struct Odometry {
    /// By frame: its parent, and its poses in the parent.
    frames: BTreeMap<String, (String, Trajectory)>,
    /// The frame that the odometry describes, and the sensor's pose in it where no transform gives one.
    base: String,
    base_from_sensor: Pose,
}

impl Odometry {
    /// An odometry without poses. Errors: axes in the layout, because poses are for the frame that the messages name.
    pub fn new(layout: &Layout) -> Result<Odometry, SourceError> {
        if layout.deskew && layout.axes != Layout::default().axes {
            let found = &layout.axes;
            return Err(SourceError::field("deskew: axes", "x,y,z", found));
        }
        Ok(Odometry {
            frames: BTreeMap::new(),
            base: String::new(),
            base_from_sensor: pose(layout.base_from_sensor),
        })
    }

    /// Takes a message in CDR, by its type. `is_fixed`: its poses are valid at any time. A message that cannot be read is logged and left out.
    pub fn take(&mut self, schema: &str, is_fixed: bool, message: &[u8]) {
        if self.read(schema, is_fixed, message).is_none() {
            tracing::warn!("cannot read a pose, it is left out: {schema}");
        }
    }

    fn read(&mut self, schema: &str, is_fixed: bool, message: &[u8]) -> Option<()> {
        let mut reader = Reader::of(Cloud::Ros2, message)?;
        let mut count = 1;
        if schema == TRANSFORMS {
            count = reader.number()?;
        }
        for _ in 0..count {
            let (stamp_ns, parent) = reader.header()?;
            let mut child = String::new();
            if schema != POSE {
                child = reader.text()?;
            }
            let mut numbers = [0.0; 7];
            for number in &mut numbers {
                *number = reader.float()?;
            }
            let [x, y, z, i, j, k, w] = numbers;
            let rotation = UnitQuaternion::try_new(Quaternion::new(w, i, j, k), 1e-6)?;
            let is_known = self.frames.len() < FRAMES_MAX || self.frames.contains_key(&child);
            if !numbers.iter().all(|v| v.is_finite()) || !is_known {
                return None;
            }
            let rotation = rotation.to_rotation_matrix();
            let pose = IsometryMatrix3::from_parts(Translation3::new(x, y, z), rotation);
            if schema != TRANSFORMS {
                self.base.clone_from(&child);
            }
            let (its_parent, trajectory) = self.frames.entry(child).or_default();
            (*its_parent, trajectory.is_fixed) = (parent, is_fixed);
            trajectory.push(stamp_ns, pose);
        }
        Some(())
    }

    /// The pose of a frame in the fixed frame; `None`: not known at this time. A frame without a transform, or the last one of fixed transforms,
    /// counts as the odometry's frame.
    fn at(&self, frame: &str, stamp_ns: u64, after_s: f64) -> Option<Pose> {
        let (mut name, mut pose, mut moves) = (frame, IsometryMatrix3::identity(), false);
        // The limit also ends a cycle of frames.
        for _ in 0..FRAMES_MAX {
            // Above the odometry's frame a localization may jump (REP 105).
            let is_continuous = moves && name.ends_with("odom");
            if let Some((parent, trajectory)) = self.frames.get(name).filter(|_| !is_continuous) {
                pose = trajectory.at(stamp_ns, after_s)? * pose;
                moves |= !trajectory.is_fixed;
                name = parent;
            } else if moves || name == self.base {
                break;
            } else {
                if name == frame {
                    pose = self.base_from_sensor;
                }
                name = &self.base;
            }
        }
        moves.then_some(pose)
    }

    /// Corrects a scan in a frame for motion. A scan that cannot be corrected is logged and gets the flag `degraded`.
    pub fn correct(&self, scan: &mut Scan, frame: &str) {
        let stamp_ns = scan.stamp_ns.unwrap_or(0);
        scan.deskew(|after_s| self.at(frame, stamp_ns, after_s));
    }
}

impl Scan {
    /// Moves the points to their positions at the scan's stamp. `at`: the sensor's pose by seconds after the stamp. A scan that cannot be corrected
    /// stays as it is and gets the flag `degraded`; the log gives the reason.
    pub(crate) fn deskew(&mut self, at: impl Fn(f64) -> Option<Pose>) {
        if let Err(reason) = self.try_deskew(at) {
            tracing::warn!(scan = self.name, "not corrected for motion: {reason}");
            self.flags = self.flags.with(Flags::DEGRADED);
        }
    }

    fn try_deskew(&mut self, at: impl Fn(f64) -> Option<Pose>) -> Result<(), String> {
        if self.bytes.is_empty() {
            return Ok(());
        } else if self.times_ns.is_empty() {
            return Err(NO_TIMES.to_string());
        }
        let times_ns = self.times_ns.iter().copied();
        let first_ns = times_ns.clone().fold(f64::MAX, f64::min);
        let last_ns = times_ns.clone().fold(f64::MIN, f64::max);
        // No return has a time.
        if first_ns > last_ns {
            return Ok(());
        }
        let mut stamp_ns = 0.0;
        if last_ns > SINCE_1970_NS {
            stamp_ns = self.stamp_ns.unwrap_or(0) as f64;
        }
        let after_s = |time_ns: f64| (time_ns - stamp_ns) * 1e-9;
        let [first_s, last_s] = [first_ns, last_ns].map(after_s);
        let [shortest_s, longest_s] = TURN_S;
        if last_s - first_s < shortest_s || first_s < -longest_s || last_s > longest_s {
            let expected = format!("expected {shortest_s} s of the {longest_s} s before or after");
            let found = format!("found {first_s:.4} to {last_s:.4} s after it");
            return Err(format!("times of points: {expected} the stamp, {found}"));
        }
        let no_pose = || format!("no two poses within {BEYOND_MAX_S} s of it");
        let [Some(first), Some(here), Some(last)] = [first_s, 0.0, last_s].map(at) else {
            return Err(no_pose());
        };
        let deskew = Deskew::new([first_s, last_s], [first, last]).ok_or_else(no_pose)?;
        let (points, _) = self.bytes.as_chunks_mut::<16>();
        for (point, time_ns) in points.iter_mut().zip(times_ns) {
            let (numbers, _) = point.as_chunks();
            let at_m: [f32; 3] = from_fn(|axis| f32::from_le_bytes(numbers[axis]));
            // A missing return stays at the origin.
            if at_m != [0.0; 3] {
                let moved_m = deskew.moved(after_s(time_ns), at_m);
                let moved = moved_m.map(f32::to_le_bytes);
                point[..12].copy_from_slice(moved.as_flattened());
            }
        }
        let (_, _, yaw_rad) = here.rotation.euler_angles();
        self.pose = Some(EgoPose::new(here.translation.vector.into(), yaw_rad, 1));
        Ok(())
    }
}

pub(crate) fn pose([x, y, z, roll_rad, pitch_rad, yaw_rad]: [f64; 6]) -> Pose {
    let rotation = Rotation3::from_euler_angles(roll_rad, pitch_rad, yaw_rad);
    IsometryMatrix3::from_parts(Translation3::new(x, y, z), rotation)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ahead(x_m: f64, yaw_rad: f64) -> Pose {
        pose([x_m, 0.0, 0.0, 0.0, 0.0, yaw_rad])
    }

    #[test]
    fn poses_are_found_between_and_a_little_beyond_but_not_over_gaps_and_jumps() {
        let mut trajectory = Trajectory::default();
        // 10 m/s, a jump of a kilometre at 0.3 s, a gap of 5 s.
        let times_ms = [0, 100, 300, 400, 5400];
        for (time_ms, x_m) in times_ms.into_iter().zip([0.0, 1.0, 1000.0, 1001.0, 1.0]) {
            trajectory.push(1_000_000_000 + time_ms * 1_000_000, ahead(x_m, 0.0));
        }
        for (after_s, x_m) in [
            (0.05, Some(0.5)),
            (-0.15, Some(-1.5)),
            (-0.25, None),
            (0.19, Some(1.9)),
            (0.22, Some(999.2)),
            (0.59, Some(1002.9)),
            (2.0, None),
            (5.4, None),
        ] {
            let found = trajectory.at(1_000_000_000, after_s);
            let found = found.map(|pose| (pose.translation.x * 1e6).round() / 1e6);
            assert_eq!(found, x_m, "{after_s}");
        }
        // A recording that begins again.
        trajectory.push(1_000_000_000, ahead(0.0, 0.0));
        trajectory.push(1_050_000_000, ahead(0.5, 0.0));
        assert!(trajectory.at(1_000_000_000, 0.1).is_some());
    }

    /// 120,000 points straight ahead, within 0.1 s, from a sensor that drives at 10 m/s.
    #[test]
    fn points_go_to_the_stamp_and_what_keeps_them_is_said() {
        let bytes = [20.0f32, 0.0, -1.0, 0.5].map(f32::to_le_bytes);
        let whole = Scan {
            bytes: bytes.as_flattened().repeat(120_000),
            stamp_ns: Some(1_700_000_000_000_000_000),
            ..Scan::default()
        };
        let relative = |i: u32| f64::from(i) * 1e8 / 119_999.0;
        let at = |after_s: f64| Some(ahead(10.0 * after_s, 0.0));
        for (since_ns, first, last) in
            [(0.0, 20.0, 21.0), (1.7e18, 20.0, 21.0), (1.7e18 - 1e8, 19.0, 20.0)]
        {
            let mut scan = whole.clone();
            scan.times_ns = (0..120_000).map(|i| since_ns + relative(i)).collect();
            scan.try_deskew(at).unwrap();
            let x_m = |i: usize| f32::from_le_bytes(scan.bytes[i * 16..][..4].try_into().unwrap());
            assert!((x_m(0) - first).abs() < 2e-3 && (x_m(119_999) - last).abs() < 2e-3);
            assert_eq!(scan.pose.unwrap().position_m, [0.0; 3]);
        }
        type At = fn(f64) -> Option<Pose>;
        let [still, unknown]: [At; 2] = [|_| Some(ahead(0.0, 0.0)), |_| None];
        for (scale, at, words) in [
            (
                1e3,
                still,
                "expected 0.001 s of the 1 s before or after the stamp, found 0.0000 to 100.0000 s",
            ),
            (1e-3, still, "found 0.0000 to 0.0001 s"),
            (1.0, unknown, "no two poses within 0.2 s"),
        ] {
            let mut scan = whole.clone();
            scan.times_ns = (0..120_000).map(|i| scale * relative(i)).collect();
            assert!(scan.try_deskew(at).unwrap_err().contains(words));
            scan.deskew(at);
            assert_eq!((scan.flags, &scan.bytes), (Flags::DEGRADED, &whole.bytes));
        }
        assert_eq!(whole.clone().try_deskew(still), Err(NO_TIMES.to_string()));
    }
}
