//! Velodyne's 1206-byte packets: 12 blocks of 32 shots, the time, the return mode, the product (manual 63-9243, section 9.3).
//!
//! The azimuth of a shot is its firing's azimuth plus the rotation since the firing began (section 9.5). Where the manuals leave a choice, Nebula is
//! followed, so that clouds are the same: no rotation in a packet's last block (0.4 degrees at most) or in an HDL-64E. A VLS-128 fires one to three
//! times per packet; its last firing rotates as far as the one before. The HDL-64E reports no return mode: two returns of a shot are two points.

use super::{Calibration, Damaged, Revolution, calibration::Laser, sweep::Sweep, u16_at, u32_at};
use crate::{SourceError, refused};
use mluc_model::SensorProfile;
use serde::Deserialize;
use std::sync::LazyLock;

const BYTES: usize = 1206;
const BLOCKS: usize = 12;
const BLOCK_BYTES: usize = 100;
const BLOCK_SHOTS: usize = 32;
const STAMP_AT: usize = 1200;
const RETURNS_AT: usize = 1204;
const PRODUCT_AT: usize = 1205;
const RETURNS_DUAL: u8 = 0x39;
/// Of a VLS-128: three returns, or two and a confidence. Their blocks are in groups of three, which are not read.
const RETURNS_OTHER: [u8; 2] = [0x3A, 0x3B];
/// Flags of the blocks of lasers 0 to 31, 32 to 63, ...
const BANKS: [u16; 4] = [0xEEFF, 0xDDFF, 0xCCFF, 0xBBFF];
const HOUR_NS: u64 = 3_600_000_000_000;
const HOUR_US: u32 = 3_600_000_000;
/// No sensor turns farther within a block. A larger gap is a sector that the sensor leaves out.
const GAP_MAX_CDEG: u32 = 200;

/// A sensor model.
#[derive(Deserialize)]
pub(super) struct Product {
    /// Name in `sensors/`.
    profile: String,
    /// The last byte of a packet; the HDL-64E has its status there.
    id: Option<u8>,
    lasers: usize,
    unit_mm: u8,
    /// Time from one firing of all lasers to the next one.
    cycle_ns: u32,
    /// The beam of each laser, counted from the top, where all units are alike (VLP-32C: manual 63-9325, section 9.2).
    rings: Option<Vec<usize>>,
}

static PRODUCTS: LazyLock<Vec<Product>> = LazyLock::new(|| {
    serde_json::from_str(include_str!("velodyne.json")).expect("the table, which a test reads")
});

fn product(profile: &str) -> Option<&'static Product> {
    PRODUCTS.iter().find(|product| product.profile == profile)
}

impl Product {
    fn nominal(&self, profile: &SensorProfile) -> Option<Vec<Laser>> {
        let at = |values: &[f32], ring: usize| values.get(ring).map_or(0.0, |v| v.to_radians());
        let laser = |(laser_id, ring): (usize, &usize)| Laser {
            laser_id,
            rot_correction: at(&profile.azimuth_offsets_deg, *ring),
            vert_correction: at(&profile.elevations_deg, *ring),
            ..Laser::default()
        };
        Some(self.rings.as_ref()?.iter().enumerate().map(laser).collect())
    }
}

/// Recognizes a packet's product by its flags and last byte, else by the calibration's number of lasers.
pub(super) fn recognize(payload: &[u8], given: Option<&Calibration>) -> Option<&'static Product> {
    if payload.len() != BYTES {
        return None;
    }
    let flags: [u16; BLOCKS] = std::array::from_fn(|i| u16_at(payload, i * BLOCK_BYTES));
    let is_filled = flags.iter().all(|flag| BANKS.contains(flag) || *flag == 0);
    if !is_filled || flags[0] == 0 {
        return None;
    }
    let id = Some(payload[PRODUCT_AT]);
    if flags.iter().any(|flag| BANKS[2..].contains(flag)) {
        return product("vls-128");
    } else if flags.contains(&BANKS[1]) {
        return product("hdl-64e");
    } else if let Some(product) = PRODUCTS.iter().find(|product| product.id == id) {
        return Some(product);
    }
    let Some(Calibration::Velodyne(table)) = given else {
        return None;
    };
    match table.lasers.len() {
        16 => product("vlp-16"),
        32 if table.unit_m == Some(0.004) => product("vlp-32c"),
        32 => product("hdl-32e"),
        _ => None,
    }
}

struct Beam {
    laser: Laser,
    sin: f32,
    cos: f32,
}

pub(super) struct Velodyne {
    pub(super) name: String,
    product: &'static Product,
    unit_m: f32,
    beams: Vec<Beam>,
    last_stamp_ns: Option<u64>,
    /// Time and azimuth (0.01 degrees) of the last packet's first firing.
    last_firing: Option<(u64, u16)>,
}

impl Velodyne {
    pub(super) fn new(
        product: &'static Product,
        calibration: Option<&Calibration>,
    ) -> Result<Velodyne, SourceError> {
        let profile = SensorProfile::load(&product.profile)
            .map_err(|cause| SourceError::field(&product.profile, "a profile", cause))?;
        let (lasers, unit_m) = match calibration {
            Some(Calibration::Velodyne(table)) if table.lasers.len() == product.lasers => {
                (Some(table.lasers.clone()), table.unit_m)
            }
            Some(other) => return Err(other.is_not(&profile.name)),
            None => (product.nominal(&profile), None),
        };
        let Some(lasers) = lasers else {
            let expected = format!("the YAML file of this {}", profile.name);
            return refused("calibration: the file", expected, "none");
        };
        Ok(Velodyne {
            beams: beams(lasers),
            name: profile.name,
            product,
            unit_m: unit_m.unwrap_or(f32::from(product.unit_mm) * 0.001),
            last_stamp_ns: None,
            last_firing: None,
        })
    }

    pub(super) fn takes(&self, payload: &[u8]) -> bool {
        payload.len() == BYTES
    }

    pub(super) fn decode(
        &mut self,
        payload: &[u8],
        sweep: &mut Sweep,
        on: &mut dyn FnMut(&Revolution),
    ) -> Result<(), Damaged> {
        let lasers = self.product.lasers;
        if lasers == 128 && RETURNS_OTHER.contains(&payload[RETURNS_AT]) {
            return Err(Damaged);
        }
        let is_dual = lasers != 64 && payload[RETURNS_AT] == RETURNS_DUAL;
        let returns = if is_dual { 2 } else { 1 };
        let blocks = self.whole_blocks(payload)? / returns * returns;
        let stamp_us = u32_at(payload, STAMP_AT);
        if stamp_us >= HOUR_US {
            return Err(Damaged);
        }
        let stamp_ns = self.in_hour(u64::from(stamp_us) * 1000, sweep.received_ns);
        // A firing fills half a block, one block or several blocks.
        let firings = blocks * BLOCK_SHOTS / lasers / returns;
        let azimuth_of = |block: usize| u16_at(payload, block * BLOCK_BYTES + 2);
        let interval_ns = firings.max(1) as u64 * u64::from(self.product.cycle_ns);
        sweep.packet(stamp_ns, interval_ns, azimuth_of(0));
        // The four blocks of a VLS-128's firing have one azimuth.
        let ahead = returns * (lasers / BLOCK_SHOTS).max(1);
        let first_cdeg = azimuth_of(0);
        let before_cdeg = match self.last_firing.replace((stamp_ns, first_cdeg)) {
            _ if ahead < blocks => gap_cdeg(first_cdeg, azimuth_of(ahead)),
            // By time, since packets may have been lost.
            Some((last_ns, last_cdeg)) if last_ns < stamp_ns => {
                let gap_cdeg = u64::from(gap_cdeg(last_cdeg, first_cdeg));
                (gap_cdeg * interval_ns / (stamp_ns - last_ns)) as u32
            }
            _ => 0,
        };
        // A sector that is left out within the packet takes its time too: as long per degree as the firings beside it.
        let turned_cdeg = (ahead..blocks).map(|b| gap_cdeg(azimuth_of(b - ahead), azimuth_of(b)));
        let turned_cdeg = u64::from(turned_cdeg.max().unwrap_or(0));
        let firing_ns = interval_ns * ahead as u64 / blocks.max(1) as u64;
        let mut left_out_ns = 0;
        for block in (0..blocks).step_by(returns) {
            // The azimuth after the last firing comes with the next packet.
            let gap_cdeg = match block + ahead {
                after if after < blocks => gap_cdeg(azimuth_of(block), azimuth_of(after)),
                _ if lasers == 128 => before_cdeg,
                _ => 0,
            };
            let block_ns = stamp_ns + left_out_ns;
            self.block(payload, block, returns, gap_cdeg, block_ns, sweep, on);
            let next_cdeg = azimuth_of((block + returns).min(blocks - 1));
            let jump_cdeg = turn_cdeg(azimuth_of(block), next_cdeg);
            // An azimuth that steps back a little leaves no sector out.
            if (GAP_MAX_CDEG + 1..=35_500).contains(&jump_cdeg) && turned_cdeg > 0 {
                left_out_ns += u64::from(jump_cdeg) * firing_ns / turned_cdeg;
            }
        }
        Ok(())
    }

    fn block(
        &self,
        payload: &[u8],
        block: usize,
        returns: usize,
        gap_cdeg: u32,
        stamp_ns: u64,
        sweep: &mut Sweep,
        on: &mut dyn FnMut(&Revolution),
    ) {
        let lasers = self.product.lasers;
        let bytes = &payload[block * BLOCK_BYTES..];
        let bank = bank_of(u16_at(bytes, 0)).unwrap_or(0) * BLOCK_SHOTS;
        let azimuth_cdeg = u16_at(bytes, 2);
        let firing = block / returns * BLOCK_SHOTS / lasers;
        let cycle_ns = u64::from(self.product.cycle_ns);
        let start_ns = stamp_ns + firing as u64 * cycle_ns;
        sweep.column(azimuth_cdeg, start_ns, on);
        for shot in 0..BLOCK_SHOTS {
            let beam = &self.beams[(bank + shot) % lasers];
            let (laser_ns, turned) = self.moment(bank + shot);
            let azimuth_cdeg = f32::from(azimuth_cdeg) + gap_cdeg as f32 * turned;
            let azimuth_rad = (azimuth_cdeg / 100.0).to_radians();
            let at = [0, (returns - 1) * BLOCK_BYTES].map(|block| block + 4 + shot * 3);
            let distances = at.map(|at| u32::from(u16_at(bytes, at)));
            sweep.shot(distances, |slot, sweep| {
                let xyz_m = beam.position_m(distances[slot] as f32 * self.unit_m, azimuth_rad);
                let reflectivity = bytes[at[slot] + 2];
                sweep.point(xyz_m, reflectivity, start_ns + laser_ns);
            });
        }
    }

    /// Time of a shot since its firing's start, ns, and rotation since the block's azimuth, as a share of the way to the next block's azimuth.
    fn moment(&self, shot: usize) -> (u64, f32) {
        match self.product.lasers {
            16 => {
                let ns = (shot / 16) as u64 * 55_296 + (shot % 16) as u64 * 2_304;
                (ns, ns as f32 / 110_592.0)
            }
            // An HDL-32E.
            32 if self.product.cycle_ns == 46_080 => {
                let ns = shot as u64 * 1_152;
                (ns, ns as f32 / 46_080.0)
            }
            // Two lasers fire at once. The azimuth advances per laser all the same, as in the other decoders.
            32 => ((shot / 2) as u64 * 2_304, shot as f32 * 2_304.0 / 55_296.0),
            // Eight lasers fire at once; a pause follows the first half (manual 63-9483, firing sequence).
            128 => {
                let slot = (shot / 8 + shot / 64) as u64;
                (slot * 2_665, slot as f32 * 2_665.0 / 53_300.0)
            }
            // No times within the firing's 48 us are known.
            _ => (0, 0.0),
        }
    }

    /// The number of blocks before the empty ones at the end (with two returns, a VLS-128 leaves four empty).
    fn whole_blocks(&self, payload: &[u8]) -> Result<usize, Damaged> {
        let lasers = self.product.lasers;
        for block in 0..BLOCKS {
            let bytes = &payload[block * BLOCK_BYTES..];
            let flag = u16_at(bytes, 0);
            if flag == 0 && lasers == 128 && block > 0 {
                return Ok(block);
            }
            let bank = bank_of(flag).ok_or(Damaged)?;
            if bank * BLOCK_SHOTS >= lasers || u16_at(bytes, 2) >= 36_000 {
                return Err(Damaged);
            }
        }
        Ok(BLOCKS)
    }

    /// Adds the hour to a time within the hour: the hour that continues from the last packet, else the hour nearest to the arrival.
    fn in_hour(&mut self, in_hour_ns: u64, received_ns: u64) -> u64 {
        let is_near = |last: &u64| last.abs_diff(received_ns) < HOUR_NS / 4 * 3;
        let near_ns = self.last_stamp_ns.filter(is_near).unwrap_or(received_ns);
        let hour_ns = near_ns - near_ns % HOUR_NS;
        let stamp_ns = match hour_ns + in_hour_ns {
            ns if ns > near_ns + HOUR_NS / 2 && ns >= HOUR_NS => ns - HOUR_NS,
            ns if ns + HOUR_NS / 2 < near_ns => ns + HOUR_NS,
            ns => ns,
        };
        self.last_stamp_ns = Some(stamp_ns);
        stamp_ns
    }
}

/// The angle from one azimuth to the next.
fn turn_cdeg(from: u16, to: u16) -> u32 {
    (u32::from(to) + 36_000 - u32::from(from)) % 36_000
}

/// The same; 0 over a sector that was left out.
fn gap_cdeg(from: u16, to: u16) -> u32 {
    let gap_cdeg = turn_cdeg(from, to);
    if gap_cdeg > GAP_MAX_CDEG { 0 } else { gap_cdeg }
}

fn bank_of(flag: u16) -> Option<usize> {
    BANKS.iter().position(|bank| *bank == flag)
}

fn beams(lasers: Vec<Laser>) -> Vec<Beam> {
    let beam = |laser: Laser| {
        let (sin, cos) = laser.vert_correction.sin_cos();
        Beam { laser, sin, cos }
    };
    lasers.into_iter().map(beam).collect()
}

impl Beam {
    /// The manual's model of a laser (63-9194, appendix on calibration). The manual's y is ahead, its x to the right.
    fn position_m(&self, distance_m: f32, azimuth_rad: f32) -> [f32; 3] {
        let laser = &self.laser;
        let distance_m = distance_m + laser.dist_correction;
        let (sin, cos) = (azimuth_rad - laser.rot_correction).sin_cos();
        let (up_m, aside_m) = (laser.vert_offset_correction, laser.horiz_offset_correction);
        let level_m = |distance_m: f32| distance_m * self.cos - up_m * self.sin;
        let right_m = |distance_m: f32| level_m(distance_m) * sin - aside_m * cos;
        let ahead_m = |distance_m: f32| level_m(distance_m) * cos + aside_m * sin;
        let (mut for_right_m, mut for_ahead_m) = (distance_m, distance_m);
        if laser.two_pt_correction_available {
            // Corrections are measured at 2.4 m and 1.93 m, and at 25.04 m, where the correction is `dist_correction`.
            let corrected = |at_m: f32, near_m: f32, near_correction_m: f32| {
                let share = (at_m.abs() - near_m) / (25.04 - near_m) - 1.0;
                distance_m + (laser.dist_correction - near_correction_m) * share
            };
            for_right_m = corrected(right_m(distance_m), 2.4, laser.dist_correction_x);
            for_ahead_m = corrected(ahead_m(distance_m), 1.93, laser.dist_correction_y);
        }
        let z_m = for_ahead_m * self.sin + up_m * self.cos;
        [ahead_m(for_ahead_m), -right_m(for_right_m), z_m]
    }
}
