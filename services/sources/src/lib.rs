//! Files, captures and sockets to scans. No shared memory here: the caller publishes what comes out.
//!
//! [`Source`] is a folder of scans, whose [`files`] have several formats; [`packets`] decodes what sensors send, without I/O; [`pcap`] reads captures, [`udp`] listens to a live sensor.

pub mod files;
mod folder;
pub mod packets;
pub mod pcap;
pub mod udp;

pub use folder::Source;
