//! The revolution under construction: where it ends, which packets are lost, how many points it keeps.

use super::{Counts, Revolution};
use mluc_ipc_types::{POINTS_MAX, Point};

/// Half a turn at 20 Hz, the fastest rate of these sensors. A revolution that began at a cut lasts at least this long.
const TURN_MIN_NS: u64 = 25_000_000;
/// Longer than a turn at 5 Hz, the slowest rate. If more time passes, the sensor was silent or its clock was set.
const TURN_MAX_NS: u64 = 500_000_000;
/// About ten seconds of packets, more than any queue loses. If more are missing, the sensor was restarted or silent.
const LOST_MAX: u64 = 20_000;
/// Farther back than any late packet. A larger step back begins the next turn, where a sensor leaves a sector out.
const BACK_CDEG: u16 = 500;

/// Collects a bounded number of points into revolutions.
#[derive(Default)]
pub(super) struct Sweep {
    pub(super) counts: Counts,
    /// Time of arrival of the current datagram.
    pub(super) received_ns: u64,
    revolution: Revolution,
    /// Whether a shot has come.
    is_open: bool,
    begins_whole: bool,
    last_azimuth_cdeg: Option<u16>,
    last_column_ns: u64,
    /// Duration of the last turn without a loss.
    turn_ns: u64,
    last_sequence: Option<u64>,
    last_packet_ns: Option<u64>,
    /// Packets lost before the current datagram.
    lost_before: u32,
    /// Time and azimuth of the packet after the last gap.
    last_gap: Option<(u64, u16)>,
}

impl Sweep {
    /// Takes a packet's sequence number, which counts modulo `modulus`.
    pub(super) fn sequence(&mut self, sequence: u64, modulus: u64) {
        self.lost_before = 0;
        let last = self.last_sequence.replace(sequence);
        let Some(last) = last else { return };
        let step = (sequence + modulus - last) % modulus;
        match step {
            1 => {}
            2..=LOST_MAX => self.lost(step - 1),
            _ if step == 0 || modulus - step <= LOST_MAX => {
                self.counts.late += 1;
                self.last_sequence = Some(last);
            }
            _ => {}
        }
    }

    /// Takes a packet's time by the sensor's clock and its first azimuth, for packets without numbers. A gap at the same azimuth as in the last turn
    /// is a sector that the sensor leaves out.
    pub(super) fn packet(&mut self, stamp_ns: u64, interval_ns: u64, azimuth_cdeg: u16) {
        self.lost_before = 0;
        let last = self.last_packet_ns.replace(stamp_ns);
        let Some(last) = last else { return };
        match stamp_ns.checked_sub(last) {
            Some(step) if step > 0 => {
                let packets = (step + interval_ns / 2) / interval_ns;
                if (2..=LOST_MAX).contains(&packets) {
                    let gap = self.last_gap.replace((stamp_ns, azimuth_cdeg));
                    let is_sector = gap.is_some_and(|(at_ns, at_cdeg)| {
                        // The first azimuth after the sector varies by a packet's rotation, up to 9.6 degrees (VLP-16, 20 Hz).
                        let off_cdeg = at_cdeg.abs_diff(azimuth_cdeg);
                        stamp_ns.saturating_sub(at_ns) > TURN_MIN_NS
                            && off_cdeg.min(36_000u16.saturating_sub(off_cdeg)) < 2 * BACK_CDEG
                    });
                    self.lost(if is_sector { 0 } else { packets - 1 });
                }
            }
            _ if last - stamp_ns < TURN_MAX_NS => {
                self.counts.late += 1;
                self.last_packet_ns = Some(last);
            }
            _ => {}
        }
    }

    /// Takes a packet that cannot be decoded: the turn lacks its points.
    pub(super) fn damaged(&mut self) {
        self.counts.damaged += 1;
        let lost = &mut self.revolution.packets_lost;
        *lost = lost.saturating_add(1);
    }

    fn lost(&mut self, packets: u64) {
        self.counts.lost += packets;
        self.lost_before = packets as u32;
        let lost = &mut self.revolution.packets_lost;
        *lost = lost.saturating_add(packets as u32);
    }

    /// Starts a column of shots at an azimuth (0.01 degrees), the earliest at `stamp_ns`. Ends the revolution where the azimuth passes 0.
    pub(super) fn column(
        &mut self,
        azimuth_cdeg: u16,
        stamp_ns: u64,
        on: &mut dyn FnMut(&Revolution),
    ) {
        let last = self.last_azimuth_cdeg.replace(azimuth_cdeg).unwrap_or(azimuth_cdeg);
        let passes_zero =
            last > azimuth_cdeg + BACK_CDEG || azimuth_cdeg > last.saturating_add(18_000);
        let age_ns = stamp_ns.abs_diff(self.revolution.stamp_ns);
        let goes_on = stamp_ns > self.last_column_ns;
        self.last_column_ns = stamp_ns;
        // A late packet begins no new turn. At the border, packets pass 0 more than once. A field around azimuth 0 ends at its gap, not at 0.
        let least_ns = TURN_MIN_NS.max(self.turn_ns / 20 * 9);
        if passes_zero && goes_on && (!self.begins_whole || age_ns >= least_ns) {
            if age_ns <= TURN_MAX_NS && self.revolution.packets_lost == 0 {
                self.turn_ns = age_ns;
            }
            // Packets lost around the border are divided between both turns by their angles.
            let [before, after] = [last, azimuth_cdeg].map(|at| u64::from(at.min(36_000)));
            let (before, after) = match after > before {
                true => (before, 36_000 - after),
                false => (36_000 - before, after),
            };
            let lost = u64::from(self.lost_before) * after;
            let lost = (lost + (before + after) / 2) / (before + after).max(1);
            self.cut(age_ns <= TURN_MAX_NS, lost as u32, on);
        }
        self.lost_before = 0;
        self.shots(stamp_ns, on);
    }

    /// Starts shots, the earliest at `stamp_ns`. Ends a revolution that is too old for them.
    pub(super) fn shots(&mut self, stamp_ns: u64, on: &mut dyn FnMut(&Revolution)) {
        if self.is_open && self.revolution.stamp_ns.abs_diff(stamp_ns) > TURN_MAX_NS {
            self.cut(false, 0, on);
        }
        if !self.is_open {
            self.is_open = true;
            self.revolution.stamp_ns = stamp_ns;
            self.revolution.received_ns = self.received_ns;
        }
    }

    /// Whether nothing came for longer than a turn.
    pub(super) fn was_silent(&self) -> bool {
        self.received_ns.abs_diff(self.revolution.received_ns) > TURN_MAX_NS
    }

    /// Calls `point` for each of a shot's two returns that is above 0, only once where both are the same. A sensor with one return repeats it.
    pub(super) fn shot(&mut self, distances: [u32; 2], mut point: impl FnMut(usize, &mut Sweep)) {
        for slot in [0, 1] {
            let is_new = slot == 0 || distances[1] != distances[0];
            if distances[slot] > 0 && is_new {
                point(slot, self);
            }
        }
    }

    /// Adds a point: `xyz_m` in the frame of the [module](super), reflectivity of 0 to 255.
    pub(super) fn point(&mut self, xyz_m: [f32; 3], reflectivity: u8, stamp_ns: u64) {
        let revolution = &mut self.revolution;
        // Ingest counts and flags what is beyond its own limit; no sensor's turn reaches this one.
        if revolution.points.len() == 4 * POINTS_MAX {
            return;
        }
        let [x_m, y_m, z_m] = xyz_m;
        revolution.points.push(Point { x_m, y_m, z_m, intensity: f32::from(reflectivity) / 255.0 });
        let offset_ns = stamp_ns.saturating_sub(revolution.stamp_ns);
        // Bounded by `TURN_MAX_NS` and a packet's length.
        revolution.offsets_ns.push(offset_ns as u32);
    }

    /// Passes the revolution to `on` and begins the next one. `is_whole`: a turn ends here and the next one starts. `lost_after`: how many of the
    /// packets lost just before belong to the next revolution, at most.
    pub(super) fn cut(&mut self, is_whole: bool, lost_after: u32, on: &mut dyn FnMut(&Revolution)) {
        let begins_whole = std::mem::replace(&mut self.begins_whole, is_whole);
        if !std::mem::take(&mut self.is_open) {
            return;
        }
        let lost_after = lost_after.min(self.lost_before);
        let revolution = &mut self.revolution;
        revolution.packets_lost -= lost_after.min(revolution.packets_lost);
        revolution.is_partial = !(begins_whole && is_whole);
        self.counts.revolutions += 1;
        on(revolution);
        revolution.points.clear();
        revolution.offsets_ns.clear();
        revolution.packets_lost = lost_after;
    }
}
