//! Merges scans of several sensors into frames: the first sensor's scan, and from each other sensor the next scan within a tolerance.
//!
//! Packets are matched by their time of arrival, which is one clock for all sensors; recordings by the stamps of their messages; folders by
//! `timestamps.txt`, followed ones by the files' times; inputs without stamps by number. Each scan is in one frame at most.

use crate::{Kind, Next, Open, Scan, Source, files::Layout, motion::pose, recording::LOOKS_MAX};
use anyhow::{Context, ensure};
use mluc_ipc_types::{EgoPose, Flags};
use nalgebra::{IsometryMatrix3, Point3};
use serde::{Deserialize, Serialize};
use std::{path::PathBuf, time::Duration, time::Instant};

/// `[[lidar]]`: one of several sensors.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Lidar {
    /// For people.
    pub name: String,
    /// As [`Source::open`] takes it.
    pub input: PathBuf,
    /// Its pose in the robot's base: x, y, z (m), roll, pitch, yaw (rad), turned about x, then y, then z.
    pub extrinsics: [f64; 6],
    /// In place of the layout's.
    pub calibration: Option<PathBuf>,
    /// In place of the layout's.
    pub topic: Option<String>,
}

/// Number of the frame, time of its first scan (ns), and when that scan was read.
type Frame = (u64, Option<u64>, Instant);

pub(crate) struct Merged {
    pub(crate) parts: Vec<Part>,
    tolerance: Duration,
    /// The sensor whose scans begin the frames: the first live sensor that is not silent, or the first of all.
    leader: usize,
    frame: Option<Frame>,
    /// Names of the sensors that are not in the last frame, each after a space.
    pub(crate) missing: String,
}

/// A sensor and its next scan.
pub(crate) struct Part {
    name: String,
    pub(crate) source: Source,
    frame_from_sensor: IsometryMatrix3<f32>,
    scan: Scan,
    has_scan: bool,
    /// Number of the scan after `scan`.
    number: u64,
    is_over: bool,
    /// Whether the scan belongs to the frame; `None`: not known yet.
    is_in: Option<bool>,
    /// Number of consecutive frames without this sensor.
    frames_without: u64,
}

/// A live scan further ahead of the frame is not kept: a clock was set back, or a stamp is wrong.
const AHEAD_MAX_NS: u64 = 1_000_000_000;

impl Source {
    /// Merges scans of several sensors into frames, which the first sensor's scans begin. `base_from_frame`: pose of the frames in the robot's base, as
    /// [`Lidar::extrinsics`]. `tolerance_ms`: limit between the times of scans in a frame. Errors: as [`Source::open`], with the sensor's name.
    pub fn merge(
        lidars: &[Lidar],
        layout: &Layout,
        base_from_frame: [f64; 6],
        tolerance_ms: u64,
        open: Open,
    ) -> anyhow::Result<Source> {
        let frame_from_base = pose(base_from_frame).inverse();
        let part = |lidar: &Lidar| {
            let (name, mut layout) = (lidar.name.clone(), layout.clone());
            layout.shard = None;
            layout.calibration = lidar.calibration.clone().or(layout.calibration);
            layout.topic = lidar.topic.clone().or(layout.topic);
            if layout.deskew {
                layout.base_from_sensor = lidar.extrinsics;
            }
            let source = open(&lidar.input, &layout, false);
            anyhow::Ok(Part {
                source: source.with_context(|| format!("[[lidar]] {name}"))?,
                name,
                frame_from_sensor: (frame_from_base * pose(lidar.extrinsics)).cast(),
                scan: Scan::default(),
                has_scan: false,
                number: 0,
                is_over: false,
                is_in: None,
                frames_without: 0,
            })
        };
        let parts: Vec<Part> = lidars.iter().map(part).collect::<Result<_, _>>()?;
        let live = parts.iter().filter(|part| part.source.is_live()).count();
        let expected = "[[lidar]]: expected live sensors alone, or none";
        ensure!([0, parts.len()].contains(&live), "{expected}, found {live} of {}", parts.len());
        let kind = Kind::Merged(Merged {
            parts,
            tolerance: Duration::from_millis(tolerance_ms),
            leader: 0,
            frame: None,
            missing: String::new(),
        });
        Source::of(kind, false, layout)
    }
}

impl Merged {
    /// As [`Source::load`].
    pub(crate) fn load(&mut self, sequence: u64, scan: &mut Scan) -> anyhow::Result<Next> {
        if self.frame.is_none_or(|frame| frame.0 != sequence) {
            let is_heard = |part: &Part| part.source.silence().is_none();
            self.leader = self.parts.iter().position(is_heard).unwrap_or(0);
            let leader = &mut self.parts[self.leader];
            let next = leader.source.load(sequence, &mut leader.scan)?;
            if next != Next::Scan {
                return Ok(next);
            }
            self.frame = Some((sequence, time_ns_of(&leader.scan), Instant::now()));
            for part in &mut self.parts {
                part.has_scan &= part.is_in != Some(true);
                part.is_in = None;
            }
            self.parts[self.leader].is_in = Some(true);
        }
        for part in &mut self.parts {
            if let (None, Some(frame)) = (part.is_in, self.frame) {
                part.is_in = part.seek(frame, self.tolerance);
            }
            if part.is_in.is_none() {
                return Ok(Next::NotYet);
            }
        }
        self.tell(sequence);
        self.write(scan);
        Ok(Next::Scan)
    }

    /// Counts frames without a sensor; logs which sensors are missing from this frame on, and which are back.
    fn tell(&mut self, sequence: u64) {
        self.missing.clear();
        for part in &mut self.parts {
            let (name, frames) = (&part.name, part.frames_without);
            let is_missing = !part.is_there();
            part.frames_without = (frames + 1) * u64::from(is_missing);
            if is_missing {
                self.missing += &format!(" {name}");
            }
            if is_missing && frames == 0 {
                tracing::warn!(sequence, "lidar {name} is missing: frames go on without it");
            } else if !is_missing && frames > 0 {
                tracing::info!(sequence, "lidar {name} is back: {frames} frames without it");
            }
        }
    }

    /// Writes the points of all scans that are in the frame; name, stamp and pose are the leader's.
    fn write(&self, scan: &mut Scan) {
        let first = &self.parts[self.leader];
        let leader = &first.scan;
        scan.bytes.clear();
        let mut flags = Flags::default();
        for part in &self.parts {
            if part.is_in == Some(true) {
                flags = flags.with(part.write_points(&mut scan.bytes));
            }
            if !part.is_there() {
                flags = flags.with(Flags::DEGRADED);
            }
        }
        *scan = Scan {
            bytes: std::mem::take(&mut scan.bytes),
            name: leader.name.clone(),
            flags,
            pose: leader.pose.map(|pose| first.pose_of_frame(pose)),
            times_ns: vec![],
            arrived: leader.arrived.or(self.frame.map(|frame| frame.2)),
            ..*leader
        };
    }
}

impl Part {
    /// Whether the frame has points of this sensor.
    fn is_there(&self) -> bool {
        self.is_in == Some(true) && !self.scan.bytes.is_empty()
    }

    /// Whether the sensor has a scan for the frame; `None`: call again. A sensor that fails is treated as one that ends: the others continue.
    fn seek(&mut self, frame: Frame, tolerance: Duration) -> Option<bool> {
        let (sequence, frame_ns, begun) = frame;
        for _ in 0..LOOKS_MAX {
            if self.is_over {
                return Some(false);
            }
            if !self.has_scan {
                let is_late = self.source.silence().is_some() || begun.elapsed() > tolerance;
                let number = frame_ns.map_or(sequence, |_| self.number);
                let (source, scan) = (&mut self.source, &mut self.scan);
                let next = match &mut source.kind {
                    // The points of a folder's scan are loaded below.
                    Kind::Folder(_) => source.pass_over(number, scan),
                    Kind::Live(live) if is_late => live.load(scan, Duration::ZERO),
                    _ => source.load(number, scan),
                };
                let next = next.unwrap_or_else(|error| {
                    tracing::error!("lidar {}: {error:#}", self.name);
                    Next::End
                });
                if next == Next::NotYet {
                    return (is_late && self.source.is_live()).then_some(false);
                }
                (self.has_scan, self.is_over) = (next == Next::Scan, next == Next::End);
                self.number = number + 1;
                continue;
            }
            let is_near = match (time_ns_of(&self.scan), frame_ns) {
                (Some(own_ns), Some(frame_ns)) => {
                    let is_near = own_ns.abs_diff(frame_ns) <= tolerance.as_nanos() as u64;
                    let ahead_ns = own_ns.saturating_sub(frame_ns);
                    let is_possible = !self.source.is_live() || ahead_ns < AHEAD_MAX_NS;
                    self.has_scan = is_near || (ahead_ns > 0 && is_possible);
                    is_near
                }
                (own_ns, frame_ns) => own_ns == frame_ns,
            };
            if let (Kind::Folder(folder), true) = (&self.source.kind, is_near) {
                folder.load(self.number - 1, &mut self.scan);
            }
            if self.has_scan {
                return Some(is_near);
            }
        }
        None
    }

    /// Pose of the frame's coordinates for a pose of the sensor, seen from above.
    fn pose_of_frame(&self, sensor: EgoPose) -> EgoPose {
        let IsometryMatrix3 { rotation, translation } = self.frame_from_sensor.cast::<f64>();
        let yaw_rad = sensor.yaw_rad - rotation.euler_angles().2;
        let off_m = pose([0.0, 0.0, 0.0, 0.0, 0.0, yaw_rad]) * translation.vector;
        EgoPose {
            position_m: std::array::from_fn(|axis| sensor.position_m[axis] - off_m[axis]),
            yaw_rad,
            ..sensor
        }
    }

    /// Appends the points in the frame's coordinates; returns the scan's flags.
    fn write_points(&self, bytes: &mut Vec<u8>) -> Flags {
        let (points, _) = self.scan.bytes.as_chunks::<16>();
        for point in points {
            let (numbers, _) = point.as_chunks();
            let [x, y, z, intensity] = std::array::from_fn(|i| f32::from_le_bytes(numbers[i]));
            let mut at = Point3::new(x, y, z);
            // A missing return stays at the origin.
            if at != Point3::origin() {
                at = self.frame_from_sensor * at;
            }
            let numbers = [at.x, at.y, at.z, intensity].map(f32::to_le_bytes);
            bytes.extend_from_slice(numbers.as_flattened());
        }
        self.scan.flags
    }
}

/// The time by which scans are merged.
fn time_ns_of(scan: &Scan) -> Option<u64> {
    scan.received_ns.or(scan.stamp_ns)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::packets::tests::{HOUR_NS, velodyne};
    use std::{net::UdpSocket, sync::atomic::AtomicU32, sync::atomic::Ordering::Relaxed};

    fn lidar(name: &str, input: String) -> Lidar {
        Lidar {
            name: name.to_string(),
            input: input.into(),
            extrinsics: [0.0; 6],
            calibration: None,
            topic: None,
        }
    }

    #[test]
    fn live_sensors_may_fall_silent_the_first_one_too_and_come_back() {
        let free = [(); 2].map(|()| UdpSocket::bind("127.0.0.1:0").unwrap());
        let ports = free.map(|socket| socket.local_addr().unwrap());
        let sensors = [("front", ports[0]), ("rear", ports[1])];
        let lidars = sensors.map(|(name, port)| lidar(name, format!("udp:{port}")));
        let source = Source::merge(&lidars, &Layout::default(), [0.0; 6], 50, Source::open);
        let mut source = source.unwrap();
        // A bit for each sensor that sends.
        static SENDING: AtomicU32 = AtomicU32::new(3);
        std::thread::spawn(move || {
            let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
            for n in 0.. {
                let packet = velodyne([34, 1, 40, 55, 0], n as u32, HOUR_NS + n * 1_327_104);
                let bits = SENDING.load(Relaxed);
                for bit in [0, 1].into_iter().filter(|bit| bits >> bit & 1 == 1) {
                    socket.send_to(&packet, ports[bit]).unwrap();
                }
                std::thread::sleep(Duration::from_micros(200));
            }
        });
        let (mut scan, mut sequence, begun) = (Scan::default(), 0, Instant::now());
        for (bits, missing) in [(3u32, ""), (1, " rear"), (2, " front"), (3, "")] {
            SENDING.store(bits, Relaxed);
            let bytes = bits.count_ones() as usize * 75 * 384 * 16;
            while source.missing() != missing || scan.bytes.len() != bytes {
                let next = source.load(sequence, &mut scan).unwrap();
                sequence += u64::from(next == Next::Scan);
                let is_early = begun.elapsed() < Duration::from_secs(30);
                assert!(is_early, "{bits}: without{}", source.missing());
            }
        }
    }

    /// Scans with these stamps, ms. The sensor is 10 m ahead and faces back.
    struct Stamped(std::vec::IntoIter<u64>);

    impl crate::LiveScans for Stamped {
        fn load(&mut self, scan: &mut Scan, _: Duration) -> anyhow::Result<Next> {
            let stamp = self.0.next();
            scan.received_ns = stamp.map(|ms| ms * 1_000_000);
            scan.bytes = vec![0; 16];
            scan.pose = Some(EgoPose::new([10.0, 0.0, 0.0], std::f64::consts::PI, 1));
            Ok(stamp.map_or(Next::NotYet, |_| Next::Scan))
        }

        fn silence(&self) -> Option<String> {
            None
        }
    }

    #[test]
    fn a_live_scan_of_the_far_future_is_let_go_and_frames_have_poses_of_their_own() {
        let stamps = ["1000,1100,1200", "90000,1100,1200"];
        let mut lidars = stamps.map(|stamps| lidar(&stamps[..2], stamps.to_string()));
        // At the robot's rear.
        lidars[0].extrinsics = [-2.0, 0.0, 0.0, 0.0, 0.0, std::f64::consts::PI];
        let open: Open = |input, layout, _| {
            let stamps = input.to_str().unwrap().split(',').map(|ms| ms.parse().unwrap());
            let stamps = stamps.collect::<Vec<_>>().into_iter();
            Source::live(Stamped(stamps), layout)
        };
        // Merged sensors and a live sensor have no parts; one scan has no second part.
        let [first, second] =
            [0, 1].map(|index| Layout { shard: Some([index, 2]), ..Layout::default() });
        let merged = Source::merge(&lidars, &first, [0.0; 6], 50, open);
        let scan = tempfile::Builder::new().suffix(".bin").tempfile().unwrap();
        let second = Source::open(scan.path(), &second, false);
        for refused in [merged, open(&lidars[0].input, &first, false), second] {
            let error = format!("{:#}", refused.err().expect("an error"));
            assert!(error.contains("shard: expected"), "{error}");
        }
        let mut source = Source::merge(&lidars, &Layout::default(), [0.0; 6], 50, open).unwrap();
        let mut missing = |sequence| {
            let mut scan = Scan::default();
            assert_eq!(source.load(sequence, &mut scan).unwrap(), Next::Scan);
            let pose = scan.pose.unwrap();
            let off = (pose.position_m[0] - 12.0).abs() + pose.yaw_rad.abs();
            assert!(off < 1e-5, "{pose:?}");
            source.missing().to_string()
        };
        assert_eq!([0, 1, 2].map(&mut missing), [" 90", "", ""]);
    }
}
