//! Files, captures and sockets to scans. No shared memory here: the caller publishes what comes out.
//!
//! [`Source`] is what `--input` names: a folder of scans, whose [`files`] have several formats; [`packets`] decodes what sensors send, without I/O; [`pcap`] reads captures, [`udp`] listens to a live sensor.

mod error;
pub mod files;
mod folder;
pub mod packets;
pub mod pcap;
pub mod udp;

use std::path::Path;

use mluc_ipc_types::{EgoPose, Flags};

pub use error::SourceError;
use files::Layout;
use folder::Folder;

/// One scan, as ingest publishes it; its memory is used again for the next one.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scan {
    /// x, y, z (m, sensor frame: forward, left, up), intensity (0 to 1): four little-endian f32 a point.
    pub bytes: Vec<u8>,
    /// The frame's name: its file's, or a number.
    pub name: String,
    /// What is known to be wrong with it.
    pub flags: Flags,
    /// The sensor's time, ns; `None`: not known.
    pub stamp_ns: Option<u64>,
    /// When it comes after the source's first scan, ns; `None`: not known.
    pub offset_ns: Option<u64>,
    /// Where the sensor was.
    pub pose: Option<EgoPose>,
}

/// Where scans come from.
#[derive(Clone, Debug)]
pub struct Source {
    folder: Folder,
    repeat: bool,
}

impl Source {
    /// Opens what `input` is; `repeat`: after the last scan the first one comes again. Errors: what is wrong with it, and what helps.
    pub fn open(input: &Path, layout: &Layout, repeat: bool) -> anyhow::Result<Source> {
        let folder = Folder::find(input, layout)?;
        Ok(Source { folder, repeat })
    }

    /// How many scans there are.
    pub fn count(&self) -> u64 {
        self.folder.scans.len() as u64
    }

    /// Which of the scans a number is that counts on over all rounds.
    pub fn index(&self, sequence: u64) -> u64 {
        sequence % self.count()
    }

    /// The name of a scan, by its index.
    pub fn name(&self, index: u64) -> String {
        self.folder.name(index as usize)
    }

    /// As [`Source::load`], for a scan that nobody may read: no points.
    pub fn pass_over(&mut self, sequence: u64, scan: &mut Scan) -> bool {
        let is_there = self.repeat || sequence < self.count();
        if is_there {
            scan.bytes.clear();
            scan.flags = Flags::DAMAGED_INPUT;
            self.folder.describe(sequence, scan);
        }
        is_there
    }

    /// Loads a scan by its number, which counts on over all rounds; false: there is none any more.
    pub fn load(&mut self, sequence: u64, scan: &mut Scan) -> bool {
        let is_there = self.repeat || sequence < self.count();
        if is_there {
            self.folder.load(sequence, scan);
        }
        is_there
    }
}
