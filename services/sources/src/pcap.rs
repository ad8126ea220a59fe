//! UDP datagrams of a capture file, pcap or pcapng: Ethernet with VLANs, Linux cooked, loopback or raw IP; fragments are reassembled.

use crate::packets::{Calibration, Datagram, Decoder, Detector, LOOKS_MAX};
use crate::{SourceError, refused};
use etherparse::{NetSlice, SlicedPacket, TransportSlice, UdpSlice, defrag::IpDefragPool};
use pcap_parser::{Linktype, PcapBlockOwned, PcapError, create_reader, traits::PcapReaderIterator};
use std::path::{Path, PathBuf};
use std::{fs::File, net::IpAddr, net::SocketAddr};

/// Longer than any frame of a capture.
const BUFFER_BYTES: usize = 1 << 20;
/// Limit for other blocks of a pcapng file, such as secrets or comments, which may be longer; an estimate.
const BLOCK_BYTES_MAX: usize = 64 << 20;
/// A datagram's fragments wait for the missing ones until this many more fragments have come.
const FRAGMENTS_MAX: u64 = 1024;
/// Number of interfaces of a pcapng file that are kept.
const INTERFACES_MAX: usize = 64;

/// Stamp, link and bytes of a frame.
type Frame<'a> = (u64, Linktype, &'a [u8]);
/// Stamp, sender and port of a datagram.
type Address = (u64, SocketAddr, u16);

/// Counts of a capture's frames and datagrams.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CaptureCounts {
    /// UDP datagrams returned.
    pub datagrams: u64,
    /// Frames that are not a whole UDP datagram or have no time: other protocols, frames cut by the recorder.
    pub other: u64,
    /// Fragmented datagrams with a part that is missing or has not come yet.
    pub fragmented_lost: u64,
    /// The file ends within a block, is damaged there, or the block is above 64 MiB. The rest of the file is not read.
    pub cut_short: bool,
}

/// Link type, time resolution and time offset of an interface.
#[derive(Clone, Copy)]
struct Interface {
    link: Linktype,
    ticks_per_s: u64,
    offset_s: i64,
}

/// A capture that is read from its start to its end.
pub struct Capture {
    path: PathBuf,
    is_ng: bool,
    reader: Box<dyn PcapReaderIterator + Send>,
    interfaces: Vec<Interface>,
    frames: Frames,
}

/// Extracts datagrams from frames.
#[derive(Default)]
struct Frames {
    counts: CaptureCounts,
    payload: Vec<u8>,
    /// Incomplete datagrams, each with the number of its latest fragment.
    pool: IpDefragPool<u64>,
    fragments: u64,
}

impl Capture {
    /// Opens a file; its first bytes determine its format.
    pub fn open(path: impl AsRef<Path>) -> Result<Capture, SourceError> {
        let path = path.as_ref().to_path_buf();
        let file = File::open(&path).map_err(|cause| SourceError::io(path.display(), cause))?;
        let found = match create_reader(BUFFER_BYTES, file) {
            Ok(reader) => {
                return Ok(Capture {
                    path,
                    is_ng: reader.data().starts_with(&[0x0A, 0x0D, 0x0D, 0x0A]),
                    reader,
                    interfaces: Vec::new(),
                    frames: Frames::default(),
                });
            }
            Err(PcapError::Eof) => "an empty file",
            Err(PcapError::Incomplete(_)) => "a file that ends in its header",
            Err(_) => "neither",
        };
        refused(path.display(), "a pcap or pcapng capture", found)
    }

    /// The decoder for the first sensor in the capture. Open the capture again to decode it from its start.
    pub fn detect(mut self, calibration: Option<&Calibration>) -> Result<Decoder, SourceError> {
        let (mut detector, mut other) = (Detector::new(calibration), None);
        for _ in 0..LOOKS_MAX {
            let Some(datagram) = self.next_datagram()? else {
                break;
            };
            match detector.look(&datagram) {
                Ok(Some(decoder)) => {
                    other.inspect(|error| tracing::warn!("another sensor: {error}"));
                    return Ok(decoder);
                }
                Ok(None) => (),
                Err(error) => other = other.or(Some(error)),
            }
        }
        let counts = self.counts();
        let parts = counts.other + counts.fragmented_lost;
        if other.is_none() && parts > 0 && counts.datagrams < counts.fragmented_lost.max(1) {
            let help = "cut by the recorder (tcpdump -s 0), fragments filtered out (`udp port N` keeps only the first of each datagram), or of another kind of network?";
            let found = format!("{parts} frames that are no whole datagram: {help}");
            return refused("packets", "UDP datagrams", found);
        }
        Err(other.unwrap_or_else(|| detector.not_found()))
    }

    /// The counts so far.
    pub fn counts(&self) -> CaptureCounts {
        self.frames.counts
    }

    /// The next datagram; `None` at the end. Fails where the system cannot read further.
    pub fn next_datagram(&mut self) -> Result<Option<Datagram<'_>>, SourceError> {
        loop {
            if self.is_ng && is_impossible(self.reader.data()) {
                break;
            }
            match self.reader.next() {
                Ok((bytes, block)) => {
                    let frame = read(&block, &mut self.interfaces);
                    let found = frame.and_then(|frame| self.frames.datagram(frame));
                    self.reader.consume(bytes);
                    if let Some((stamp_ns, from, to_port)) = found {
                        let payload = &self.frames.payload;
                        return Ok(Some(Datagram { stamp_ns, from, to_port, payload }));
                    }
                }
                Err(PcapError::Eof) => return Ok(None),
                Err(PcapError::Incomplete(_)) => {
                    if self.reader.refill().is_err() {
                        let cause = std::io::Error::other("reading failed");
                        return Err(SourceError::io(self.path.display(), cause));
                    }
                }
                Err(error) => {
                    let is_long = matches!(error, PcapError::BufferTooSmall);
                    // No block is longer than its file, whatever length it states.
                    let bytes = std::fs::metadata(&self.path).map_or(0, |file| file.len());
                    if !is_long || !self.reader.grow(BLOCK_BYTES_MAX.min(bytes as usize)) {
                        break;
                    }
                }
            }
        }
        self.frames.counts.cut_short = true;
        Ok(None)
    }
}

/// Whether the data begin with a process block that is shorter than any block can be: pcap-parser 0.17 subtracts from its length unchecked.
fn is_impossible(data: &[u8]) -> bool {
    let Some(&[kind, length]) = data.as_chunks().0.first_chunk() else {
        return false;
    };
    const KIND: u32 = 0x8000_0001;
    let read = [u32::from_le_bytes, u32::from_be_bytes];
    read.iter().any(|read| read(kind) == KIND && read(length) < 16)
}

/// Returns the frame in a block; stores the interfaces that other blocks describe.
fn read<'a>(block: &'a PcapBlockOwned, interfaces: &mut Vec<Interface>) -> Option<Frame<'a>> {
    use pcap_parser::Block;
    let mut told = |link, ticks_per_s, offset_s| {
        if interfaces.len() < INTERFACES_MAX {
            interfaces.push(Interface { link, ticks_per_s, offset_s });
        }
    };
    match block {
        PcapBlockOwned::LegacyHeader(header) => {
            let is_ns = header.is_nanosecond_precision();
            let ticks_per_s = if is_ns { 1_000_000_000 } else { 1_000_000 };
            told(header.network, ticks_per_s, 0);
            None
        }
        PcapBlockOwned::Legacy(frame) => {
            let interface = interfaces.first()?;
            let ns = u64::from(frame.ts_usec) * (1_000_000_000 / interface.ticks_per_s);
            let stamp_ns = u64::from(frame.ts_sec) * 1_000_000_000 + ns;
            Some((stamp_ns, interface.link, frame.data))
        }
        PcapBlockOwned::NG(Block::SectionHeader(_)) => {
            interfaces.clear();
            None
        }
        PcapBlockOwned::NG(Block::InterfaceDescription(description)) => {
            let exponent = u32::from(description.if_tsresol & 0x7F);
            let is_binary = description.if_tsresol & 0x80 != 0;
            let base = if is_binary { 2u64 } else { 10 };
            let ticks_per_s = base.checked_pow(exponent).unwrap_or(u64::MAX);
            told(description.linktype, ticks_per_s, description.if_tsoffset);
            None
        }
        PcapBlockOwned::NG(Block::EnhancedPacket(frame)) => {
            let interface = interfaces.get(frame.if_id as usize)?;
            let ticks = i128::from(u64::from(frame.ts_high) << 32 | u64::from(frame.ts_low));
            let ns = ticks * 1_000_000_000 / i128::from(interface.ticks_per_s);
            let stamp_ns = ns + i128::from(interface.offset_s) * 1_000_000_000;
            let stamp_ns = u64::try_from(stamp_ns).unwrap_or(0);
            let bytes = frame.data.get(..frame.caplen as usize)?;
            Some((stamp_ns, interface.link, bytes))
        }
        // A packet without a time is of no use. Its empty frame is counted as `other`.
        PcapBlockOwned::NG(Block::SimplePacket(_)) => Some((0, Linktype::ETHERNET, &[])),
        PcapBlockOwned::NG(_) => None,
    }
}

impl Frames {
    /// A frame's datagram; the content is in `payload`.
    fn datagram(&mut self, (stamp_ns, link, frame): Frame) -> Option<Address> {
        let sliced = match link {
            Linktype::ETHERNET => SlicedPacket::from_ethernet(frame),
            // Without a known hardware type (loopback) the packet follows sixteen bytes all the same.
            Linktype::LINUX_SLL => SlicedPacket::from_linux_sll(frame)
                .or_else(|_| SlicedPacket::from_ip(frame.get(16..).unwrap_or_default())),
            // Twenty bytes before the packet (`tcpdump -i any`).
            Linktype::LINUX_SLL2 => SlicedPacket::from_ip(frame.get(20..).unwrap_or_default()),
            // Four bytes of address family before the packet.
            Linktype::NULL | Linktype::LOOP => {
                SlicedPacket::from_ip(frame.get(4..).unwrap_or_default())
            }
            _ => SlicedPacket::from_ip(frame),
        };
        let found = match &sliced {
            Ok(packet) if packet.is_ip_payload_fragmented() => {
                return self.fragment(stamp_ns, packet);
            }
            Ok(packet) => match &packet.transport {
                Some(TransportSlice::Udp(udp)) => sender(packet).map(|ip| (ip, udp.clone())),
                _ => None,
            },
            Err(_) => None,
        };
        let Some((ip, udp)) = found else {
            self.counts.other += 1;
            return None;
        };
        self.give(stamp_ns, ip, &udp)
    }

    fn give(&mut self, stamp_ns: u64, ip: IpAddr, udp: &UdpSlice) -> Option<Address> {
        self.payload.clear();
        self.payload.extend_from_slice(udp.payload());
        self.counts.datagrams += 1;
        let from = SocketAddr::new(ip, udp.source_port());
        Some((stamp_ns, from, udp.destination_port()))
    }

    fn fragment(&mut self, stamp_ns: u64, packet: &SlicedPacket) -> Option<Address> {
        self.fragments += 1;
        let now = self.fragments;
        if now.is_multiple_of(FRAGMENTS_MAX) {
            self.pool.retain(|latest| latest + FRAGMENTS_MAX > now);
        }
        if let Some(NetSlice::Ipv4(ip)) = &packet.net
            && ip.header().fragments_offset().value() == 0
        {
            self.counts.fragmented_lost += 1;
        }
        let whole = self.pool.process_sliced_packet(packet, now, ());
        let whole = whole.ok().flatten()?;
        self.counts.fragmented_lost = self.counts.fragmented_lost.saturating_sub(1);
        let is_udp = whole.ip_number == etherparse::IpNumber::UDP;
        let udp = UdpSlice::from_slice(&whole.payload).ok().filter(|_| is_udp);
        let found = match (udp, sender(packet)) {
            (Some(udp), Some(ip)) => self.give(stamp_ns, ip, &udp),
            _ => {
                self.counts.other += 1;
                None
            }
        };
        self.pool.return_buf(whole);
        found
    }
}

fn sender(packet: &SlicedPacket) -> Option<IpAddr> {
    match packet.net.as_ref()? {
        NetSlice::Ipv4(ip) => Some(ip.header().source_addr().into()),
        NetSlice::Ipv6(ip) => Some(ip.header().source_addr().into()),
        NetSlice::Arp(_) => None,
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use etherparse::{IpFragOffset, Ipv4Header, PacketBuilder};

    const POINTS: [u8; 3000] = [7; 3000];

    pub(crate) fn ethernet(payload: &[u8]) -> Vec<u8> {
        let mut frame = vec![];
        let builder =
            PacketBuilder::ethernet2([1; 6], [2; 6]).single_vlan(5u16.try_into().unwrap());
        let builder = builder.ipv4([10, 0, 0, 1], [10, 0, 0, 2], 9);
        builder.udp(2368, 2369).write(&mut frame, payload).unwrap();
        frame
    }

    /// The same datagram in fragments of 1000 bytes, after their Ethernet header.
    fn fragments(payload: &[u8]) -> Vec<Vec<u8>> {
        let mut udp = vec![];
        let words = [2368, 2369, payload.len() as u16 + 8, 0].map(u16::to_be_bytes);
        udp.extend(words.as_flattened());
        udp.extend(payload);
        let mut frames = vec![];
        for (i, part) in udp.chunks(1000).enumerate() {
            let (bytes, protocol) = (part.len() as u16, etherparse::IpNumber::UDP);
            let mut ip = Ipv4Header::new(bytes, 9, protocol, [10, 0, 0, 1], [10, 0, 0, 2]).unwrap();
            ip.dont_fragment = false;
            ip.more_fragments = (i + 1) * 1000 < udp.len();
            ip.fragment_offset = IpFragOffset::try_new(i as u16 * 125).unwrap();
            let mut frame = vec![1; 12];
            frame.extend([8, 0]);
            ip.write(&mut frame).unwrap();
            frame.extend(part);
            frames.push(frame);
        }
        frames
    }

    /// A capture, little-endian, microseconds, Ethernet; one frame per millisecond.
    pub(crate) fn pcap(frames: &[Vec<u8>]) -> Vec<u8> {
        let mut bytes = vec![
            0xD4, 0xC3, 0xB2, 0xA1, 2, 0, 4, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 4, 0, 1, 0, 0, 0,
        ];
        for (i, frame) in frames.iter().enumerate() {
            let length = frame.len() as u32;
            for word in [100, i as u32 * 1000, length, length] {
                bytes.extend(word.to_le_bytes());
            }
            bytes.extend(frame);
        }
        bytes
    }

    /// One interface with nanoseconds, a packet of `simple_bytes` without a time, one frame at 100.000000123 s.
    fn pcapng(frame: &[u8], simple_bytes: usize) -> Vec<u8> {
        let block = |kind: u32, body: &[u8]| {
            let padded = body.len().next_multiple_of(4);
            let length = (12 + padded as u32).to_le_bytes();
            let pad = &[0; 3][..padded - body.len()];
            [&kind.to_le_bytes(), &length, body, pad, &length].concat()
        };
        let (link, ends) = ([1, 0, 0, 0, 0, 0, 4, 0], [0; 4]);
        let nanoseconds = [9, 0, 1, 0, 9, 0, 0, 0];
        let bytes = frame.len() as u32;
        let ns = 100_000_000_123u64;
        let words = [0, (ns >> 32) as u32, ns as u32, bytes, bytes].map(u32::to_le_bytes);
        let section = [&[0x4D, 0x3C, 0x2B, 0x1A, 1, 0, 0, 0][..], &[255; 8]].concat();
        let section = block(0x0A0D_0D0A, &section);
        let interface = block(1, &[&link[..], &nanoseconds, &ends].concat());
        let simple = block(3, &vec![0; 4 + simple_bytes]);
        let packet = block(6, &[words.as_flattened(), frame].concat());
        [section, interface, simple, packet].concat()
    }

    /// Stamp, port and content of each datagram.
    type Found = Vec<(u64, u16, Vec<u8>)>;

    fn read_all(bytes: &[u8]) -> Result<(Found, CaptureCounts), SourceError> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), bytes).unwrap();
        let (mut capture, mut found) = (Capture::open(file.path())?, vec![]);
        while let Some(datagram) = capture.next_datagram()? {
            assert_eq!(datagram.from.to_string(), "10.0.0.1:2368");
            let payload = datagram.payload.to_vec();
            found.push((datagram.stamp_ns, datagram.to_port, payload));
        }
        Ok((found, capture.counts()))
    }

    #[test]
    fn datagrams_are_found_among_other_traffic_and_fragments() {
        let mut frames = vec![ethernet(&POINTS[..1206]), vec![0xFF; 60], vec![]];
        frames.extend(fragments(&POINTS));
        // The end of a second datagram is missing.
        frames.extend(fragments(&POINTS).into_iter().take(2));
        let (found, counts) = read_all(&pcap(&frames)).unwrap();
        let expected =
            CaptureCounts { datagrams: 2, other: 2, fragmented_lost: 1, cut_short: false };
        assert_eq!(counts, expected);
        let first = (100_000_000_000, 2369, POINTS[..1206].to_vec());
        assert_eq!(found, [first, (100_006_000_000, 2369, POINTS.to_vec())]);
        // A block that is longer than the buffer is read too.
        let (found, counts) = read_all(&pcapng(&ethernet(b"points"), 2 << 20)).unwrap();
        assert_eq!(found, [(100_000_000_123, 2369, b"points".to_vec())]);
        assert_eq!((counts.other, counts.cut_short), (1, false));
    }

    #[test]
    fn a_capture_cut_anywhere_gives_its_whole_frames() {
        let frame = ethernet(b"points");
        for whole in [pcap(&[frame.clone(), frame.clone()]), pcapng(&frame, 0)] {
            let (all, _) = read_all(&whole).unwrap();
            for end in 24..whole.len() {
                // A pcapng file that ends in its first block is not one.
                let found = read_all(&whole[..end]);
                assert!(found.is_ok_and(|(found, _)| found.len() < all.len()) || end < 28);
            }
        }
    }

    #[test]
    fn what_is_no_capture_is_an_error() {
        for (bytes, expected) in [("", "an empty file"), ("VERSION 0.7 of what else", "neither")] {
            let error = read_all(bytes.as_bytes()).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
        // The second one is what `udp port N` keeps of a datagram in fragments.
        let first = fragments(&POINTS).into_iter().take(1).collect();
        for frames in [vec![ethernet(&POINTS)[..96].to_vec()], first] {
            let file = tempfile::NamedTempFile::new().unwrap();
            std::fs::write(file.path(), pcap(&frames)).unwrap();
            let error = Capture::open(file.path()).unwrap().detect(None).err().unwrap().to_string();
            assert!(error.contains("1 frames that are no whole datagram"), "{error}");
        }
        let error = Capture::open("/no/such.pcap").err().unwrap().to_string();
        assert!(error.contains("/no/such.pcap"), "{error}");
    }
}
