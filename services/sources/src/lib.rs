//! Reads scans from files, captures and sockets. It uses no shared memory: the caller publishes the scans.
//!
//! [`Source`] opens what `--input` names. A folder contains scans as [`files`] of several formats. [`packets`] decodes sensor packets without I/O;
//! [`pcap`] reads captures and [`udp`] listens to a live sensor. A recording (MCAP) contains scans as messages. [`Source::merge`] merges several
//! sensors. [`Source::live`] takes a source that another program implements ([`LiveScans`]). [`Odometry`] corrects scans for motion.

mod arguments;
mod capture;
mod deskew;
mod error;
pub mod files;
mod folder;
mod growing;
mod live;
mod merged;
mod motion;
pub mod packets;
pub mod pcap;
mod recording;
mod rounds;
mod shard;
pub mod udp;

use anyhow::{Context, anyhow, bail};
use capture::CaptureScans;
use files::Layout;
use folder::Folder;
use growing::Growing;
use live::{Live, PATIENCE};
use merged::Merged;
use mluc_ipc_types::{EgoPose, Flags};
use recording::Recording;
use std::{path::Path, time::Duration, time::Instant};

pub use arguments::{INPUT, LayoutArgs};
pub use deskew::Deskew;
pub use error::SourceError;
use error::refused;
pub use growing::FOLLOW;
use live::address;
pub use merged::Lidar;
pub use motion::{ODOMETRY, Odometry, TF, TRANSFORMS};
pub use recording::Recorded;
pub use shard::{place, shard};

/// One scan, as ingest publishes it; its memory is reused for the next one.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scan {
    /// x, y, z (m, sensor frame: forward, left, up), intensity (0 to 1): four little-endian f32 per point.
    pub bytes: Vec<u8>,
    /// Time of each point, ns, after the stamp or since 1970; empty: not known or not requested.
    pub times_ns: Vec<f64>,
    /// The scan's name: the name of its file, or a number.
    pub name: String,
    /// The known faults of the scan.
    pub flags: Flags,
    /// The sensor's time, ns; `None`: not known.
    pub stamp_ns: Option<u64>,
    /// When its first packet arrived, by the clock of the receiver or recorder, ns; `None`: it has no such time.
    pub received_ns: Option<u64>,
    /// When a live scan was whole; `None`: just now, or the scan is recorded.
    pub arrived: Option<Instant>,
    /// Time since the source's first scan, ns; `None`: not known.
    pub offset_ns: Option<u64>,
    /// Pose of the sensor.
    pub pose: Option<EgoPose>,
    /// Number of scans of a live sensor just before this one that were not loaded in time.
    pub missed: u64,
}

/// Whether there is another scan.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Next {
    /// The scan is loaded.
    Scan,
    /// There is no scan yet, as with a live sensor: call again.
    NotYet,
    /// There are no more scans.
    End,
}

/// A source of scans.
pub struct Source {
    kind: Kind,
    repeat: bool,
    /// Part I of N: every Nth scan.
    shard: Option<[u32; 2]>,
}

enum Kind {
    Folder(Folder),
    Capture(Box<CaptureScans>),
    Recording(Box<Recording>),
    Live(Box<dyn LiveScans>),
    Merged(Merged),
}

/// Scans that come when the sensor sends them.
pub trait LiveScans: Send {
    /// Loads the newest scan that was not loaded yet; waits `patience` at most. A scan without a name gets a number. Errors: only if the source ends.
    fn load(&mut self, scan: &mut Scan, patience: Duration) -> anyhow::Result<Next>;

    /// The message while no scan arrives.
    fn silence(&self) -> Option<String>;

    /// Skips the scans that are there: an earlier process has loaded them.
    fn go_on(&mut self) -> anyhow::Result<()> {
        Ok(())
    }
}

/// Opens an input, as [`Source::open`] does.
pub type Open = fn(&Path, &Layout, bool) -> anyhow::Result<Source>;

/// Whether an input is a live sensor, a topic or a folder that grows.
pub fn is_live(input: &Path) -> bool {
    address(input).is_some() || ros2_topic(input).is_some() || followed(input).is_some()
}

/// Whether an input names nothing to read: no path, or an invalid address.
pub fn is_incomplete(input: &Path) -> bool {
    let nothing = ["", FOLLOW, "ros2:", "ros2:/"];
    address(input).is_some_and(|address| address.is_err())
        || input.to_str().is_some_and(|text| nothing.contains(&text))
}

/// The folder of an input like `follow:DIR`; `None`: the input is of another kind.
fn followed(input: &Path) -> Option<&str> {
    input.to_str()?.strip_prefix(FOLLOW)
}

/// The topic of an input like `ros2:/points`, which the program `mluc-ros2` opens; `None`: the input is of another kind.
pub fn ros2_topic(input: &Path) -> Option<&str> {
    input.to_str()?.strip_prefix("ros2:")
}

/// Options of the layout that have no effect on this input.
pub fn idle_options(input: &Path, layout: &Layout) -> Vec<&'static str> {
    let ending = ending(input);
    let is_packets = address(input).is_some() || matches!(&*ending, "pcap" | "pcapng");
    let is_topic = ros2_topic(input).is_some();
    let is_recording = recording::within(input, &ending).is_some();
    let is_files = !(is_packets || is_topic || is_recording);
    let has_odometry = layout.deskew && (is_topic || is_recording);
    let options = [
        ("columns", !layout.columns.is_empty() && !is_files),
        ("calibration", layout.calibration.is_some() && !is_packets),
        ("topic", layout.topic.is_some() && !is_recording),
        ("odometry", layout.odometry.is_some() && !has_odometry),
    ];
    options.into_iter().filter(|(_, is_idle)| *is_idle).map(|(name, _)| name).collect()
}

impl Source {
    /// A source that another program implements. Errors: the layout requests a part (shard) of it.
    pub fn live(scans: impl LiveScans + 'static, layout: &Layout) -> anyhow::Result<Source> {
        Source::of(Kind::Live(Box::new(scans)), false, layout)
    }

    fn of(kind: Kind, repeat: bool, layout: &Layout) -> anyhow::Result<Source> {
        if layout.mirrors() && !matches!(kind, Kind::Merged(_)) {
            let axes = &layout.axes;
            tracing::warn!(
                "axes {axes} mirror the scan: correct only if the file's coordinates are left-handed"
            );
        }
        let shard = layout.shard;
        let is_whole = repeat || matches!(kind, Kind::Live(_) | Kind::Merged(_));
        if shard.is_some() && is_whole {
            let expected = "one input of files, a capture or a recording, once";
            let found = "a live sensor, [[lidar]] or --loop";
            return Ok(refused("shard", expected, found)?);
        }
        let source = Source { kind, repeat, shard };
        if let (Some([index, parts]), Some(0)) = (shard, source.count()) {
            let found = format!("part {index} of {parts}, and fewer scans");
            return Ok(refused("shard", "a part with scans", &found)?);
        }
        Ok(source)
    }

    /// Opens an input: a file or folder of scans, a capture, a recording, or an address (`udp:2368`). `repeat`: the first scan follows the last one.
    /// Errors: what is wrong with the input, and what helps.
    pub fn open(input: &Path, layout: &Layout, repeat: bool) -> anyhow::Result<Source> {
        let ending = ending(input);
        let kind = if let Some(address) = address(input) {
            Kind::Live(Box::new(Live::open(address?, layout)?))
        } else if let Some(folder) = followed(input) {
            Kind::Live(Box::new(Growing::open(folder, layout)?))
        } else if ros2_topic(input).is_some() {
            let input = input.display();
            bail!("input {input}: a ROS 2 topic is read by `mluc up` and `mluc doctor` alone")
        } else if matches!(ending.as_str(), "pcap" | "pcapng") {
            Kind::Capture(Box::new(CaptureScans::open(input, layout)?))
        } else if let Some(recording) = recording::within(input, &ending) {
            Kind::Recording(Box::new(Recording::open(&recording, layout)?))
        } else {
            Kind::Folder(Folder::find(input, layout)?)
        };
        let has_poses = match &kind {
            _ if !layout.deskew => Ok(()),
            Kind::Folder(folder) => folder.check_motion(),
            Kind::Recording(_) => Ok(()),
            _ => Err(anyhow!("expected poses as folders, recordings and ROS 2 topics have them")),
        };
        has_poses.with_context(|| format!("input {}: deskew", input.display()))?;
        Source::of(kind, repeat, layout).with_context(|| format!("input {}", input.display()))
    }

    /// The source of the first sensor where several are merged, else this source.
    fn first(&self) -> &Source {
        match &self.kind {
            Kind::Merged(merged) => &merged.parts[0].source,
            _ => self,
        }
    }

    /// Names of the merged sensors that are missing in the last scan, each after a space.
    pub fn missing(&self) -> &str {
        match &self.kind {
            Kind::Merged(merged) => &merged.missing,
            _ => "",
        }
    }

    /// How many scans there are; `None`: not known.
    pub fn count(&self) -> Option<u64> {
        let count = match &self.first().kind {
            Kind::Folder(folder) => Some(folder.scans.len() as u64),
            Kind::Recording(recording) => recording.count,
            _ => None,
        };
        count.map(|count| shard::scans(self.shard, count))
    }

    /// The index of a scan by its number, which continues over all rounds.
    pub fn index(&self, sequence: u64) -> u64 {
        self.count().map_or(sequence, |count| sequence % count)
    }

    /// The name of a scan, by its index.
    pub fn name(&self, index: u64) -> String {
        let index = place(self.shard, index);
        match &self.first().kind {
            Kind::Folder(folder) => folder.name(index as usize),
            _ => numbered(index),
        }
    }

    /// Whether scans come when the sensor sends them.
    pub fn is_live(&self) -> bool {
        matches!(self.first().kind, Kind::Live(_))
    }

    /// The message while a live sensor is silent, or while all merged sensors are silent.
    pub fn silence(&self) -> Option<String> {
        match &self.kind {
            Kind::Live(live) => live.silence(),
            Kind::Merged(merged) => {
                let silent = merged.parts.iter().map(|part| part.source.silence());
                silent.collect::<Option<Vec<_>>>()?.pop()
            }
            _ => None,
        }
    }

    /// Continues after an earlier process, which has loaded the scans so far: a growing folder begins after them.
    pub fn go_on(&mut self) -> anyhow::Result<()> {
        match &mut self.kind {
            Kind::Live(live) => live.go_on(),
            Kind::Merged(merged) => merged.parts.iter_mut().try_for_each(|p| p.source.go_on()),
            _ => Ok(()),
        }
    }

    /// As [`Source::load`], but without points, for a scan that must not be read. A capture or a recording is read on; a live sensor gives its next scan.
    pub fn pass_over(&mut self, sequence: u64, scan: &mut Scan) -> anyhow::Result<Next> {
        let part = sequence;
        let sequence = place(self.shard, part);
        let next = match &mut self.kind {
            Kind::Folder(folder) if self.repeat || sequence < folder.scans.len() as u64 => {
                folder.describe(sequence, scan);
                Next::Scan
            }
            Kind::Capture(capture) => capture.load(sequence, self.repeat, scan)?,
            Kind::Recording(recording) => recording.load(sequence, self.repeat, scan)?,
            Kind::Merged(merged) => merged.parts[0].source.pass_over(sequence, scan)?,
            _ => return self.load(part, scan),
        };
        scan.bytes.clear();
        scan.times_ns.clear();
        scan.flags = Flags::DAMAGED_INPUT;
        Ok(next)
    }

    /// Loads a scan by its number, which continues over all rounds and never decreases in a capture or recording. Errors: of the system or live packets.
    pub fn load(&mut self, sequence: u64, scan: &mut Scan) -> anyhow::Result<Next> {
        let sequence = place(self.shard, sequence);
        match &mut self.kind {
            Kind::Live(live) => {
                let next = live.load(scan, PATIENCE)?;
                if scan.name.is_empty() {
                    scan.name = numbered(sequence);
                }
                Ok(next)
            }
            Kind::Merged(merged) => merged.load(sequence, scan),
            Kind::Capture(capture) => capture.load(sequence, self.repeat, scan),
            Kind::Recording(recording) => recording.load(sequence, self.repeat, scan),
            Kind::Folder(folder) if self.repeat || sequence < folder.scans.len() as u64 => {
                folder.load(sequence, scan);
                Ok(Next::Scan)
            }
            Kind::Folder(_) => Ok(Next::End),
        }
    }
}

/// The extension of a file's name, in lower case.
fn ending(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase()
}

/// The name of a scan without a name of its own.
fn numbered(sequence: u64) -> String {
    format!("{sequence:06}")
}
