//! Files, captures and sockets to scans. No shared memory here: the caller publishes what comes out.
//!
//! [`packets`] decodes what sensors send, without I/O; [`pcap`] reads captures, [`udp`] listens to a live sensor.

pub mod packets;
pub mod pcap;
pub mod udp;
