//! Decodes packets of spinning LiDARs into revolutions. It uses no clock, no file and no socket.
//!
//! | sensors | calibration | source |
//! |---|---|---|
//! | Velodyne VLP-16, Puck Hi-Res, VLP-32C, HDL-32E | built in, or the unit's YAML file | user manuals 63-9243, 63-9325, 63-9113: data packet format, firing times |
//! | Velodyne HDL-64E, VLS-128 | YAML file | user manuals 63-9194, 63-9483 |
//! | Hesai Pandar40P, Pandar64, PandarXT-32 | built in, or the unit's CSV file | user manuals: point cloud data packet, absolute time of point cloud data |
//! | Ouster, profiles `LEGACY`, `RNG15_RFL8_NIR8`, `RNG19_RFL8_SIG16_NIR16` and `..._DUAL` | metadata JSON | firmware user manual: lidar data packet format, coordinate frames |
//!
//! The packets and the calibration determine the decoder. **Frame**: x ahead, y left, z up, m. Ahead is azimuth 0 of Velodyne and Hesai (whose
//! manuals call it y) and x of Ouster's sensor frame. **Intensity**: the sensor's 8-bit reflectivity divided by 255, 0 to 1.
//!
//! A shot without return gives no point. A revolution ends where the azimuth passes 0 or goes back, or with Ouster's frame. [`Counts`] counts drops.
//!
//! ```no_run
//! use mluc_sources::packets::{Calibration, Revolution};
//! use mluc_sources::pcap::Capture;
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let calibration = Calibration::parse(&std::fs::read_to_string("metadata.json")?)?;
//! let mut decoder = Capture::open("drive.pcap")?.detect(Some(&calibration))?;
//! let mut capture = Capture::open("drive.pcap")?;
//! let mut publish = |scan: &Revolution| println!("{} points", scan.points.len());
//! while let Some(datagram) = capture.next_datagram()? {
//!     decoder.push(&datagram, &mut publish);
//! }
//! decoder.finish(&mut publish);
//! # Ok(())
//! # }
//! ```

mod calibration;
mod hesai;
mod ouster;
mod sweep;
#[cfg(test)]
pub(crate) mod tests;
mod velodyne;

use mluc_ipc_types::Point;
use std::net::{IpAddr, SocketAddr};

pub use calibration::Calibration;
pub use ouster::{Metadata, Shot};

use crate::SourceError;
use hesai::Hesai;
use sweep::Sweep;
use velodyne::Velodyne;

/// Number of datagrams that are checked for a known sensor: some seconds of any sensor's data.
pub(crate) const LOOKS_MAX: u32 = 20_000;

/// One received UDP datagram.
#[derive(Clone, Copy, Debug)]
pub struct Datagram<'a> {
    /// Time of arrival, UTC, ns since 1970.
    pub stamp_ns: u64,
    /// The sender.
    pub from: SocketAddr,
    /// The destination port.
    pub to_port: u16,
    /// The content.
    pub payload: &'a [u8],
}

/// One turn of the sensor. The lists of points and times have the same length; both are in the order of the shots.
#[derive(Clone, Debug, Default)]
pub struct Revolution {
    /// Time of the first shot by the sensor's clock, ns: UTC since 1970 (a Velodyne's hour is the receiver's), PTP time, or since an Ouster was switched on.
    pub stamp_ns: u64,
    /// Time of arrival of the first datagram, UTC, ns since 1970.
    pub received_ns: u64,
    /// At most four times [`POINTS_MAX`](mluc_ipc_types::POINTS_MAX).
    pub points: Vec<Point>,
    /// Time of each point since `stamp_ns`, ns.
    pub offsets_ns: Vec<u32>,
    /// Number of packets that are missing in this revolution, or damaged.
    pub packets_lost: u32,
    /// Packets came for a part of the turn only. This is so at the start, at the end and around a silence of the sensor.
    pub is_partial: bool,
}

/// How many datagrams were decoded, damaged, lost, late or not from this sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Decoded packets.
    pub packets: u64,
    /// Datagrams of other senders, ports or formats: they are not this sensor's points.
    pub other_traffic: u64,
    /// Packets of this sensor with impossible content. They are not decoded.
    pub damaged: u64,
    /// Packets that never came, detected by sequence number or by time.
    pub lost: u64,
    /// Packets that came twice or after a later one. They are decoded where their turn is still open.
    pub late: u64,
    /// Revolutions passed to the callback.
    pub revolutions: u64,
}

enum Family {
    Velodyne(Velodyne),
    Hesai(Hesai),
    Ouster(Box<Metadata>),
}

/// Decodes the packets of one sensor into revolutions; see the [module](self).
pub struct Decoder {
    family: Family,
    /// The sensor's address and the port that it sends to.
    sensor: (IpAddr, u16),
    sweep: Sweep,
    /// The last packet: a recording at two interfaces has each one twice.
    last: Vec<u8>,
}

/// A packet of the right length whose content is impossible.
struct Damaged;

/// Looks for a sensor among datagrams.
pub struct Detector<'a> {
    calibration: Option<&'a Calibration>,
    /// The first few distinct lengths of the datagrams that are not from a known sensor.
    lengths: Vec<usize>,
}

impl<'a> Detector<'a> {
    /// A detector for the sensor of this calibration.
    pub fn new(calibration: Option<&'a Calibration>) -> Detector<'a> {
        Detector { calibration, lengths: Vec::new() }
    }

    /// The decoder for a datagram, if a known sensor sent it. All datagrams from the same address to the same port are that sensor's. Fails where the
    /// calibration is for another sensor, or is needed and missing. The datagram itself is not decoded yet.
    pub fn look(&mut self, datagram: &Datagram) -> Result<Option<Decoder>, SourceError> {
        let (payload, calibration) = (datagram.payload, self.calibration);
        let family = if let Some(product) = velodyne::recognize(payload, calibration) {
            Family::Velodyne(Velodyne::new(product, calibration)?)
        } else if let Some(layout) = hesai::recognize(payload) {
            Family::Hesai(Hesai::new(layout, calibration)?)
        } else if let Some(Calibration::Ouster(metadata)) = calibration
            && metadata.takes(payload)
        {
            Family::Ouster(metadata.clone())
        } else {
            if self.lengths.len() < 8 && !self.lengths.contains(&payload.len()) {
                self.lengths.push(payload.len());
            }
            return Ok(None);
        };
        Ok(Some(Decoder {
            family,
            sensor: (datagram.from.ip(), datagram.to_port),
            sweep: Sweep::default(),
            last: Vec::new(),
        }))
    }

    /// The error for the case that no datagram was from a known sensor.
    pub fn not_found(&self) -> SourceError {
        let any = "a Velodyne or Hesai sensor's (an Ouster's need its metadata as calibration)";
        let expected = self.calibration.map(Calibration::describe).unwrap_or_else(|| any.into());
        let found = match self.lengths[..] {
            [] => "no datagram".to_string(),
            _ => format!("datagrams of {:?} bytes", self.lengths),
        };
        SourceError::field("packets", expected, found)
    }
}

impl Decoder {
    /// Make and model.
    pub fn product(&self) -> &str {
        match &self.family {
            Family::Velodyne(velodyne) => &velodyne.name,
            Family::Hesai(hesai) => &hesai.name,
            Family::Ouster(metadata) => &metadata.product,
        }
    }

    /// Decodes a datagram; `on` gets the revolution that ends in it, if any.
    pub fn push(&mut self, datagram: &Datagram, on: &mut dyn FnMut(&Revolution)) {
        let (payload, sweep) = (datagram.payload, &mut self.sweep);
        // No real clock reaches this limit. It keeps sums within their type.
        sweep.received_ns = datagram.stamp_ns.min(i64::MAX as u64);
        let is_ours = (datagram.from.ip(), datagram.to_port) == self.sensor
            && match &self.family {
                Family::Velodyne(velodyne) => velodyne.takes(payload),
                Family::Hesai(hesai) => hesai.takes(payload),
                Family::Ouster(metadata) => metadata.takes(payload),
            };
        if !is_ours {
            sweep.counts.other_traffic += 1;
            return;
        }
        if payload == self.last {
            sweep.counts.late += 1;
            return;
        }
        self.last.clear();
        self.last.extend_from_slice(payload);
        let decoded = match &mut self.family {
            Family::Velodyne(velodyne) => velodyne.decode(payload, sweep, on),
            Family::Hesai(hesai) => hesai.decode(payload, sweep, on),
            Family::Ouster(metadata) => metadata.decode(payload, sweep, on),
        };
        match decoded {
            Ok(()) => sweep.counts.packets += 1,
            Err(Damaged) => sweep.damaged(),
        }
    }

    /// Passes the unfinished last revolution to `on`.
    pub fn finish(&mut self, on: &mut dyn FnMut(&Revolution)) {
        self.sweep.cut(false, 0, on);
    }

    /// The counts of the datagrams so far.
    pub fn counts(&self) -> Counts {
        self.sweep.counts
    }
}

/// Reads a little-endian number of a packet whose length was checked. A number beyond the end reads as 0.
fn u16_at(bytes: &[u8], at: usize) -> u16 {
    bytes.get(at..).and_then(<[u8]>::first_chunk).map_or(0, |b| u16::from_le_bytes(*b))
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    bytes.get(at..).and_then(<[u8]>::first_chunk).map_or(0, |b| u32::from_le_bytes(*b))
}
