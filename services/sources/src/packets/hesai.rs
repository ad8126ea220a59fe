//! Packets of Hesai's Pandar40P, Pandar64 and PandarXT-32: blocks of one shot per channel, the end time (user manuals, "point cloud data packet").
//!
//! The times of the channels within a block are from the manuals' appendix "absolute time of point cloud data".

use super::{Calibration, Damaged, Revolution, sweep::Sweep, u16_at, u32_at};
use crate::SourceError;
use mluc_model::SensorProfile;
use serde::Deserialize;
use std::sync::LazyLock;

/// Layout of a product's packet, in bytes: a header, blocks of an azimuth and one shot per channel, a tail.
#[derive(Deserialize)]
pub(super) struct Layout {
    /// Name in `sensors/`.
    profile: String,
    header: usize,
    /// Bytes before each block's azimuth.
    mark: usize,
    blocks: usize,
    channels: usize,
    shot: usize,
    /// The tail: its length without the sequence number that may follow, then the offsets of the time (us), the return mode and the date in it.
    tail: [usize; 4],
    /// Offset of the byte with the unit of distances in mm. Where it is absent, the unit is 4 mm.
    unit_at: Option<usize>,
    /// Time from one block to the next, and time of the last block relative to the packet's time.
    blocks_ns: [i64; 2],
    /// Time of each channel relative to its block.
    channel_ns: Vec<i32>,
}

static LAYOUTS: LazyLock<Vec<Layout>> = LazyLock::new(|| {
    serde_json::from_str(include_str!("hesai.json")).expect("the table, which a test reads")
});

pub(super) fn recognize(payload: &[u8]) -> Option<&'static Layout> {
    LAYOUTS.iter().find(|layout| layout.takes(payload))
}

impl Layout {
    /// Checks the length and the marks.
    fn takes(&self, payload: &[u8]) -> bool {
        let bytes = self.tail_at() + self.tail[0];
        let mut blocks = (0..self.blocks).map(|block| &payload[self.block_at(block)..]);
        [bytes, bytes + 4].contains(&payload.len())
            && match self.channels {
                64 => payload.starts_with(&[0xEE, 0xFF, 64, 6]),
                32 => payload.starts_with(&[0xEE, 0xFF]) && payload[6..8] == [32, 8],
                _ => blocks.all(|block| block.starts_with(&[0xFF, 0xEE])),
            }
    }

    fn block_bytes(&self) -> usize {
        self.mark + 2 + self.channels * self.shot
    }

    fn block_at(&self, block: usize) -> usize {
        self.header + block * self.block_bytes()
    }

    fn tail_at(&self) -> usize {
        self.block_at(self.blocks)
    }
}

pub(super) struct Hesai {
    pub(super) name: String,
    layout: &'static Layout,
    /// Azimuth clockwise, rad; sine and cosine of the elevation.
    channels: Vec<[f32; 3]>,
}

impl Hesai {
    pub(super) fn new(
        layout: &'static Layout,
        calibration: Option<&Calibration>,
    ) -> Result<Hesai, SourceError> {
        let profile = SensorProfile::load(&layout.profile)
            .map_err(|cause| SourceError::field(&layout.profile, "a profile", cause))?;
        let channels: Vec<[f32; 2]> = match calibration {
            // A profile's beams and the channels both count from the top.
            None => {
                let offsets_deg = profile.azimuth_offsets_deg.iter().copied();
                let offsets_deg = offsets_deg.chain(std::iter::repeat(0.0));
                let angles = profile.elevations_deg.iter().copied().zip(offsets_deg);
                angles.map(<[f32; 2]>::from).collect()
            }
            Some(Calibration::Hesai(own)) if own.len() == layout.channels => own.clone(),
            Some(other) => return Err(other.is_not(&profile.name)),
        };
        let directions = |[elevation_deg, azimuth_deg]: [f32; 2]| {
            let (sin, cos) = elevation_deg.to_radians().sin_cos();
            [azimuth_deg.to_radians(), sin, cos]
        };
        Ok(Hesai {
            name: profile.name,
            layout,
            channels: channels.into_iter().map(directions).collect(),
        })
    }

    pub(super) fn takes(&self, payload: &[u8]) -> bool {
        self.layout.takes(payload)
    }

    pub(super) fn decode(
        &self,
        payload: &[u8],
        sweep: &mut Sweep,
        on: &mut dyn FnMut(&Revolution),
    ) -> Result<(), Damaged> {
        let layout = self.layout;
        let [tail_bytes, stamp_at, mode_at, date_at] = layout.tail;
        let (body, tail) = payload.split_at(layout.tail_at());
        let returns = returns(tail[mode_at]).ok_or(Damaged)?;
        let unit_mm = layout.unit_at.map_or(4, |at| body[at]);
        let azimuth_of = |block: usize| u16_at(body, layout.block_at(block) + layout.mark);
        if unit_mm == 0 || (0..layout.blocks).any(|block| azimuth_of(block) >= 36_000) {
            return Err(Damaged);
        }
        let [block_ns, last_block_ns] = layout.blocks_ns;
        let micros = u64::from(u32_at(tail, stamp_at));
        let stamp_ns = seconds(&tail[date_at..]) * 1_000_000_000 + micros * 1000;
        if tail.len() > tail_bytes {
            sweep.sequence(u64::from(u32_at(tail, tail_bytes)), 1 << 32);
        } else {
            let interval_ns = block_ns * (layout.blocks / returns) as i64;
            sweep.packet(stamp_ns, interval_ns as u64, azimuth_of(0));
        }
        let earliest_ns = i64::from(layout.channel_ns.iter().copied().min().unwrap_or(0));
        for block in (0..layout.blocks).step_by(returns) {
            let later = ((layout.blocks - block - 1) / returns) as i64;
            let at_ns =
                |ns: i64| stamp_ns.saturating_add_signed(last_block_ns - later * block_ns + ns);
            sweep.column(azimuth_of(block), at_ns(earliest_ns), on);
            let shots = &body[layout.block_at(block) + layout.mark + 2..];
            for (ring, channel) in self.channels.iter().enumerate() {
                let shot = |slot: usize| &shots[slot * layout.block_bytes() + ring * layout.shot..];
                let pair = [0, returns - 1].map(shot);
                let direction = (f32::from(azimuth_of(block)) / 100.0).to_radians() + channel[0];
                let (sin, cos) = direction.sin_cos();
                let shot_ns = at_ns(i64::from(layout.channel_ns[ring]));
                let distances = pair.map(|bytes| u32::from(u16_at(bytes, 0)));
                sweep.shot(distances, |slot, sweep| {
                    let distance_m = (distances[slot] * u32::from(unit_mm)) as f32 * 0.001;
                    let [level_m, z_m] = [channel[2], channel[1]].map(|share| share * distance_m);
                    let xyz_m = [level_m * cos, -level_m * sin, z_m];
                    sweep.point(xyz_m, pair[slot][2], shot_ns);
                });
            }
        }
        Ok(())
    }
}

/// The number of blocks per azimuth in a return mode.
fn returns(mode: u8) -> Option<usize> {
    match mode {
        0x33 | 0x34 | 0x37 | 0x38 => Some(1),
        0x39 | 0x3B | 0x3C => Some(2),
        _ => None,
    }
}

/// Seconds since 1970 of a date: year (since 2000 below 70, else since 1900), month, day, hour, minute, second. After two zeros, which no date has,
/// come the seconds (`GetMicroLidarTimeU64` of Hesai's SDK 2.0). A sensor without GPS or PTP counts from any time; impossible dates are clamped.
fn seconds(date: &[u8]) -> u64 {
    if let [0, 0, seconds @ ..] = date
        && seconds[0] > 31
    {
        return u64::from(u32_at(seconds, 0).swap_bytes());
    }
    let part = |at: usize, low: u8, high: u8| u64::from(date[at].clamp(low, high));
    let year = match u64::from(date[0]) {
        year @ 0..70 => 2000 + year,
        year => 1900 + year,
    };
    let (month, day) = (part(1, 1, 12), part(2, 1, 31));
    // The days before the month. The year starts in March, so that the leap day is its last day.
    let (year, month) = match month {
        3.. => (year, month - 3),
        _ => (year - 1, month + 9),
    };
    let leap_days = year / 4 - year / 100 + year / 400;
    let days = year * 365 + leap_days + (153 * month + 2) / 5 + day - 1 - 719_468;
    days * 86_400 + part(3, 0, 23) * 3600 + part(4, 0, 59) * 60 + part(5, 0, 60)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_are_seconds_since_1970() {
        let cases = [
            ([70, 1, 1, 0, 0, 0], 0),
            ([120, 6, 25, 12, 2, 9], 1_593_086_529),
            ([24, 2, 29, 23, 59, 59], 1_709_251_199),
            ([0, 3, 1, 0, 0, 0], 951_868_800),
            ([0, 0, 0x5E, 0xF4, 0x91, 0x81], 1_593_086_337),
            ([0, 0, 0, 0, 0, 9], 946_684_809),
        ];
        for (date, expected) in cases {
            assert_eq!(seconds(&date), expected, "{date:?}");
        }
    }
}
