//! Scans from a capture of a sensor's packets.

use crate::packets::{Calibration, Decoder, Revolution};
use crate::{Next, Scan, files::Layout, numbered, pcap::Capture, rounds::Rounds};
use anyhow::{Context, Result};
use mluc_ipc_types::Flags;
use std::path::{Path, PathBuf};

/// Datagrams per call. After these the caller must call again, because it has heartbeats to send.
const LOOKS_MAX: u32 = 2000;
/// Why turns do not end.
pub(crate) const CLOCK: &str = "the sensor does not turn, or its clock stands still or goes back";

/// A capture that is decoded as it is read. The sensor's turns are numbered, including the partial turns at its start and end.
pub(crate) struct CaptureScans {
    path: PathBuf,
    layout: Layout,
    calibration: Option<Calibration>,
    capture: Capture,
    decoder: Decoder,
    /// Number of the next turn.
    sequence: u64,
    /// Uses the times at which turns were received.
    rounds: Rounds,
}

impl CaptureScans {
    pub(crate) fn open(path: &Path, layout: &Layout) -> Result<CaptureScans> {
        let calibration = calibration(layout)?;
        let detect = Capture::open(path).and_then(|capture| capture.detect(calibration.as_ref()));
        let decoder = detect.with_context(|| format!("input {}", path.display()))?;
        tracing::info!(sensor = decoder.product(), "packets");
        Ok(CaptureScans {
            path: path.to_path_buf(),
            layout: layout.clone(),
            calibration,
            capture: Capture::open(path)?,
            decoder,
            sequence: 0,
            rounds: Rounds::default(),
        })
    }

    /// Decodes up to the turn with a number, unless that turn is loaded. `repeat`: the capture begins again after its end.
    pub(crate) fn load(&mut self, sequence: u64, repeat: bool, scan: &mut Scan) -> Result<Next> {
        if sequence < self.sequence {
            return Ok(Next::Scan);
        }
        for _ in 0..LOOKS_MAX {
            let (mut is_found, mut stamp_ns) = (false, None);
            let mut take = |turn: &Revolution| {
                // A packet after a pause may end two turns; the second is a part of it.
                if stamp_ns.is_some() {
                    return;
                }
                stamp_ns = Some(turn.received_ns);
                is_found = self.sequence == sequence;
                if is_found {
                    scan.take(turn, sequence, &self.layout);
                }
                self.sequence += 1;
            };
            let datagram = self.capture.next_datagram()?;
            let is_more = datagram.is_some();
            match datagram {
                Some(datagram) => self.decoder.push(&datagram, &mut take),
                None => self.decoder.finish(&mut take),
            }
            let offset_ns = stamp_ns.map(|stamp_ns| self.rounds.offset_ns(stamp_ns));
            if is_found {
                scan.offset_ns = offset_ns;
                return Ok(Next::Scan);
            }
            if is_more {
                continue;
            }
            self.tell_counts();
            if !repeat || !self.rounds.next_round() {
                return Ok(Next::End);
            }
            // Whole rounds that an earlier process has sent are not decoded again.
            self.sequence *= (sequence / self.sequence).max(1);
            self.capture = Capture::open(&self.path)?;
            self.decoder = Capture::open(&self.path)?.detect(self.calibration.as_ref())?;
        }
        Ok(Next::NotYet)
    }

    fn tell_counts(&self) {
        let (file, packets) = (self.capture.counts(), self.decoder.counts());
        let path = self.path.display();
        tracing::info!(%path, turns = packets.revolutions, packets = packets.packets, lost = packets.lost, damaged = packets.damaged, late = packets.late,
            other = packets.other_traffic + file.other, fragments = file.fragmented_lost, "the capture's end");
        if packets.late > packets.packets / 10 {
            tracing::warn!(%path, "many packets came twice or are older than those before: recorded twice, or {CLOCK}");
        }
        if packets.damaged > packets.packets {
            let damaged = packets.damaged;
            tracing::warn!(%path, damaged, "most packets cannot be decoded: a return mode or version that is not read?");
        }
        if file.cut_short {
            tracing::warn!(%path, "the capture ends within a packet");
        }
    }
}

/// The calibration of the sensor's unit, where one is given.
pub(crate) fn calibration(layout: &Layout) -> Result<Option<Calibration>> {
    let Some(path) = &layout.calibration else {
        return Ok(None);
    };
    let about = || format!("calibration {}", path.display());
    let text = std::fs::read_to_string(path).with_context(about)?;
    Calibration::parse(&text).map(Some).with_context(about)
}

impl Scan {
    /// Fills the scan from a turn of the sensor.
    pub(crate) fn take(&mut self, turn: &Revolution, sequence: u64, layout: &Layout) {
        self.bytes.clear();
        let placed = layout.placing();
        for point in &turn.points {
            let point = [point.x_m, point.y_m, point.z_m, point.intensity];
            let numbers = placed(point.map(f64::from)).map(f32::to_le_bytes);
            self.bytes.extend_from_slice(numbers.as_flattened());
        }
        self.name = numbered(sequence);
        self.flags = Flags::default();
        if turn.packets_lost > 0 || turn.is_partial {
            self.flags = self.flags.with(Flags::DAMAGED_INPUT);
        }
        // More than 1 s apart: a sensor whose clock nobody has set counts from its start.
        let is_set = turn.stamp_ns.abs_diff(turn.received_ns) < 1_000_000_000;
        self.stamp_ns = Some([turn.received_ns, turn.stamp_ns][usize::from(is_set)]);
        self.received_ns = Some(turn.received_ns);
        (self.offset_ns, self.pose) = (None, None);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::packets::tests::{HOUR_NS, velodyne};
    use crate::pcap::tests::{ethernet, pcap};

    /// Packets of a VLP-16 from the middle of a turn to the middle of the fourth: two whole turns.
    fn frames() -> Vec<Vec<u8>> {
        let packet = |n: u64| velodyne([34, 1, 40, 55, 0], n as u32, HOUR_NS + n * 1_327_104);
        (37..37 + 225).map(|n| ethernet(&packet(n))).collect()
    }

    fn load(scans: &mut CaptureScans, sequence: u64, repeat: bool, scan: &mut Scan) -> Next {
        let mut loads = std::iter::repeat_with(|| scans.load(sequence, repeat, scan).unwrap());
        loads.find(|next| *next != Next::NotYet).unwrap()
    }

    #[test]
    fn turns_are_scans_parts_are_flagged_and_a_round_follows_the_last() {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), pcap(&frames())).unwrap();
        let mut scan = Scan::default();
        for (repeat, sequences) in [(false, 0..4), (true, 0..7), (true, 3..6), (true, 401..406)] {
            let mut scans = CaptureScans::open(file.path(), &Layout::default()).unwrap();
            for sequence in sequences.clone() {
                let next = load(&mut scans, sequence, repeat, &mut scan);
                let (points, name) = (scan.bytes.len() / 16, format!("{sequence:06}"));
                let (round, part) = (sequence / 4, sequence as usize % 4);
                let packets = [38, 75, 75, 37][part];
                let found = (next, points, &scan.name);
                assert_eq!(found, (Next::Scan, packets * 384, &name));
                assert_eq!(scan.flags.contains(Flags::DAMAGED_INPUT), packets < 75);
                // A round begins one period after the last turn began. Those that are passed over take no time.
                let begin = round.min(round % 99) * 263 + [0, 38, 113, 188][part];
                assert!(scan.offset_ns.unwrap().abs_diff(begin * 1_000_000) < 2_000_000);
            }
            let next = load(&mut scans, sequences.end, repeat, &mut scan);
            assert_eq!(next == Next::End, !repeat);
        }
    }

    #[test]
    fn of_two_turns_that_end_in_a_packet_the_second_is_none() {
        let file = tempfile::NamedTempFile::new().unwrap();
        // Columns 0.41 degrees apart: turns end within packets. Packet 37 comes after a second of silence.
        let ns = |n: u64| HOUR_NS + n * 1_327_104 + u64::from(n > 36) * 1_000_000_000;
        let packet = |n: u64| ethernet(&velodyne([34, 1, 41, 55, 0], n as u32, ns(n)));
        let packets = (0..37).chain(73..221).map(packet).collect::<Vec<_>>();
        std::fs::write(file.path(), pcap(&packets)).unwrap();
        let mut scans = CaptureScans::open(file.path(), &Layout::default()).unwrap();
        let points = [0, 1, 2].map(|sequence| {
            let mut scan = Scan::default();
            load(&mut scans, sequence, false, &mut scan);
            scan.bytes.len() / 16
        });
        assert_eq!(points, [37 * 384, 878 * 32, 878 * 32]);
    }

    #[test]
    fn a_clock_that_nobody_has_set_gives_no_stamps() {
        let stamp_ms = |stamp_ms: u64| {
            let turn = Revolution {
                stamp_ns: stamp_ms * 1_000_000,
                received_ns: 10_000_000_000,
                ..Revolution::default()
            };
            let mut scan = Scan::default();
            scan.take(&turn, 0, &Layout::default());
            scan.stamp_ns.unwrap() / 1_000_000
        };
        // The last one counts TAI, 37 s ahead of UTC.
        let clocks = [9001, 9000, 47_000];
        assert_eq!(clocks.map(stamp_ms), [9001, 10_000, 10_000]);
    }

    #[test]
    fn points_are_placed_as_those_of_files() {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), pcap(&frames())).unwrap();
        let first = |layout: &Layout| {
            let mut scan = Scan::default();
            let mut scans = CaptureScans::open(file.path(), layout).unwrap();
            load(&mut scans, 0, false, &mut scan);
            let number = |at: usize| scan.bytes[at..at + 4].try_into().unwrap();
            [0, 4, 8, 12].map(|at| f32::from_le_bytes(number(at)))
        };
        let [x, y, z, intensity] = first(&Layout::default());
        let layout = Layout {
            axes: "y,-x,z".into(),
            origin: [0.0, 0.0, 0.5],
            scale: 2.0,
            intensity_scale: 0.5,
            ..Layout::default()
        };
        let expected = [2.0 * y, -2.0 * x, 2.0 * (z - 0.5), 0.5 * intensity];
        assert_eq!(first(&layout), expected);
    }

    #[test]
    fn a_calibration_that_is_not_there_is_named() {
        let layout = Layout { calibration: Some("/nowhere.csv".into()), ..Layout::default() };
        let opened = CaptureScans::open(Path::new("any.pcap"), &layout);
        let error = format!("{:#}", opened.err().unwrap());
        assert!(error.contains("calibration /nowhere.csv"), "{error}");
    }
}
