//! Ouster's lidar packets and the metadata that they need (firmware user manual: "lidar data packet format", "coordinate frames and XYZ calculation").

use super::{Damaged, Revolution, sweep::Sweep, u16_at, u32_at};
use crate::{SourceError, refused};
use serde::Deserialize;
use serde_json::{Map, Value};
use std::{f32::consts::TAU, sync::LazyLock};

const COLUMNS_MAX: usize = 4096;
const ROWS_MAX: usize = 256;
/// A packet of at most this many frames back is late; farther back, the sensor was restarted.
const FRAMES_LATE: u16 = 4;

/// A layout of packets, in bytes.
#[derive(Debug, Deserialize)]
struct Profile {
    name: String,
    header: usize,
    column_header: usize,
    pixel: usize,
    column_footer: usize,
    footer: usize,
}

static PROFILES: LazyLock<Vec<Profile>> = LazyLock::new(|| {
    serde_json::from_str(include_str!("ouster.json")).expect("the table, which a test reads")
});

/// What the sensor reports about itself.
#[derive(Clone, Debug)]
pub struct Metadata {
    pub(super) product: String,
    profile: &'static Profile,
    /// Columns per frame.
    pub columns: usize,
    /// Pixels per column, counted from the top.
    pub rows: usize,
    columns_per_packet: usize,
    /// Rank of each packet of the full turn among the packets that the sensor sends per frame. None: the sensor does not send it.
    ranks: Vec<Option<u64>>,
    packets_per_frame: u64,
    /// Sine and cosine of the elevation and of the azimuth, for each row.
    rows_sin_cos: Vec<[f32; 4]>,
    /// From the center of the turning head to the origin of the beams: outwards, up.
    origin_m: [f32; 2],
    /// A 4 x 4 matrix, row by row; translation in m.
    sensor_from_lidar: [f32; 16],
    last_frame: Option<u16>,
}

/// A pixel of a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shot {
    /// The sensor's frame number.
    pub frame: u16,
    /// Column in the turn, as the sensor counts (staggered).
    pub column: u16,
    /// Row, counted from the top.
    pub row: u16,
    /// Ranges of the strongest and the second strongest echo, mm; 0: none.
    pub ranges_mm: [u32; 2],
    /// Reflectivities of both echoes.
    pub reflectivities: [u8; 2],
    /// Time by the sensor's clock, ns.
    pub stamp_ns: u64,
}

/// The metadata's fields, at the top level or one level down: firmware versions differ.
#[derive(Deserialize)]
struct Fields {
    beam_altitude_angles: Vec<f32>,
    beam_azimuth_angles: Vec<f32>,
    beam_to_lidar_transform: Option<[f32; 16]>,
    lidar_origin_to_beam_origin_mm: Option<f32>,
    lidar_to_sensor_transform: [f32; 16],
    udp_profile_lidar: Option<String>,
    lidar_mode: Option<String>,
    columns_per_frame: Option<usize>,
    columns_per_packet: Option<usize>,
    pixels_per_column: Option<usize>,
    column_window: Option<[usize; 2]>,
    prod_line: Option<String>,
}

impl Fields {
    fn parse(text: &str) -> Result<Fields, serde_json::Error> {
        let top: Map<String, Value> = serde_json::from_str(text)?;
        let mut all = top.clone();
        for (key, value) in top.values().filter_map(Value::as_object).flatten() {
            all.entry(key).or_insert_with(|| value.clone());
        }
        serde_json::from_value(Value::Object(all))
    }

    /// Outward offset of the beams' origin, for firmware (up to 1.13) that does not report it: Ouster SDK's `default_lidar_origin_to_beam_origin`.
    fn out_mm(&self) -> f32 {
        let line = self.prod_line.as_deref().unwrap_or_default();
        let known = [("OS-0", 27.67), ("OS-1", 15.806), ("OS-2", 13.762)];
        known.iter().find(|(name, _)| line.starts_with(name)).map_or(12.163, |(_, out_mm)| *out_mm)
    }

    /// Rows, columns, columns per packet.
    fn shape(&self) -> Result<[usize; 3], SourceError> {
        let columns_of = |mode: &str| mode.split('x').next()?.parse().ok();
        let by_mode = self.lidar_mode.as_deref().and_then(columns_of);
        let rows = self.beam_altitude_angles.len();
        let columns = self.columns_per_frame.or(by_mode).unwrap_or(0);
        let per_packet = self.columns_per_packet.unwrap_or(16);
        let is_fine = (1..=ROWS_MAX).contains(&rows)
            && rows == self.beam_azimuth_angles.len()
            && rows == self.pixels_per_column.unwrap_or(rows)
            && (1..=COLUMNS_MAX).contains(&columns)
            && per_packet > 0
            && columns.is_multiple_of(per_packet);
        if is_fine {
            return Ok([rows, columns, per_packet]);
        }
        let found = format!("{rows} altitudes, {columns} columns, {per_packet} a packet");
        let expected = "an angle of both kinds for each of pixels_per_column (1 to 256), 1 to 4096 columns, whole packets";
        refused("calibration: data_format", expected, found)
    }
}

impl Metadata {
    pub(super) fn parse(text: &str) -> Result<Metadata, SourceError> {
        let fields = Fields::parse(text)
            .map_err(|cause| SourceError::field("calibration: JSON", "Ouster's metadata", cause))?;
        let name = fields.udp_profile_lidar.as_deref().unwrap_or("LEGACY");
        let Some(profile) = PROFILES.iter().find(|profile| profile.name == name) else {
            let known: Vec<&str> = PROFILES.iter().map(|profile| &*profile.name).collect();
            return refused("calibration: udp_profile_lidar", known.join(", "), name);
        };
        let [rows, columns, columns_per_packet] = fields.shape()?;
        let (origin, origin_mm) =
            match (fields.beam_to_lidar_transform, fields.lidar_origin_to_beam_origin_mm) {
                (Some(matrix), _) => ("beam_to_lidar_transform", [matrix[3], matrix[11]]),
                (None, Some(out_mm)) => ("lidar_origin_to_beam_origin_mm", [out_mm, 0.0]),
                (None, None) => ("lidar_origin_to_beam_origin_mm", [fields.out_mm(), 0.0]),
            };
        let angles = fields.beam_altitude_angles.iter().zip(&fields.beam_azimuth_angles);
        let mut sensor_from_lidar = fields.lidar_to_sensor_transform;
        for (name, numbers) in [
            ("beam_altitude_angles", &fields.beam_altitude_angles[..]),
            ("beam_azimuth_angles", &fields.beam_azimuth_angles[..]),
            (origin, &origin_mm[..]),
            ("lidar_to_sensor_transform", &sensor_from_lidar[..]),
        ] {
            // NaN is not within the limits.
            if let Some(found) = numbers.iter().find(|v| !(-1e5..=1e5).contains(*v)) {
                return refused(format!("calibration: {name}"), "-100000 to 100000", found);
            }
        }
        let sin_cos = |(altitude, azimuth): (&f32, &f32)| {
            let (sin, cos) = altitude.to_radians().sin_cos();
            let (turn_sin, turn_cos) = (-azimuth.to_radians()).sin_cos();
            [sin, cos, turn_sin, turn_cos]
        };
        for row in sensor_from_lidar.as_chunks_mut::<4>().0 {
            row[3] /= 1000.0;
        }
        let window = fields.column_window.unwrap_or([0, columns - 1]);
        let (ranks, packets_per_frame) = ranks(window, columns, columns_per_packet);
        Ok(Metadata {
            product: format!("Ouster {}", fields.prod_line.as_deref().unwrap_or("OS")),
            profile,
            columns,
            rows,
            columns_per_packet,
            ranks,
            packets_per_frame,
            rows_sin_cos: angles.map(sin_cos).collect(),
            origin_m: origin_mm.map(|mm| mm / 1000.0),
            sensor_from_lidar,
            last_frame: None,
        })
    }

    pub(super) fn describe(&self) -> String {
        let (product, profile, bytes) = (&self.product, &self.profile.name, self.packet_bytes());
        format!("{product}, {profile}, packets of {bytes} bytes")
    }

    fn column_bytes(&self) -> usize {
        let profile = self.profile;
        profile.column_header + self.rows * profile.pixel + profile.column_footer
    }

    fn packet_bytes(&self) -> usize {
        let profile = self.profile;
        profile.header + self.columns_per_packet * self.column_bytes() + profile.footer
    }

    /// Checks the length and, where there is one, the mark of a lidar packet.
    pub(super) fn takes(&self, payload: &[u8]) -> bool {
        payload.len() == self.packet_bytes()
            && (self.profile.header == 0 || u16_at(payload, 0) == 1)
    }

    fn columns_of<'a>(&self, payload: &'a [u8]) -> impl Iterator<Item = &'a [u8]> {
        let bytes = payload.get(self.profile.header..).unwrap_or_default();
        bytes.chunks_exact(self.column_bytes()).take(self.columns_per_packet)
    }

    /// Calls `each` for every pixel of a packet's valid columns, column by column. Does nothing if it is not this sensor's packet.
    pub fn shots(&self, payload: &[u8], each: &mut dyn FnMut(&Shot)) {
        if !self.takes(payload) {
            return;
        }
        let frame = self.frame(payload);
        for column in self.columns_of(payload) {
            self.column(frame, column, each);
        }
    }

    fn frame(&self, payload: &[u8]) -> u16 {
        let at = if self.profile.header == 0 { 10 } else { 2 };
        u16_at(payload, at)
    }

    fn column(&self, frame: u16, bytes: &[u8], each: &mut dyn FnMut(&Shot)) {
        let profile = self.profile;
        let is_valid = match profile.column_footer {
            0 => u16_at(bytes, 10) & 1 == 1,
            _ => u32_at(bytes, bytes.len() - profile.column_footer) == u32::MAX,
        };
        let stamp_ns = u64::from(u32_at(bytes, 4)) << 32 | u64::from(u32_at(bytes, 0));
        let column = u16_at(bytes, 8);
        if !is_valid || usize::from(column) >= self.columns {
            return;
        }
        let pixels = bytes[profile.column_header..].chunks_exact(profile.pixel);
        for (row, pixel) in pixels.take(self.rows).enumerate() {
            let word = |at: usize| u32_at(pixel, at);
            let (ranges_mm, reflectivities) = match profile.pixel {
                4 => ([(word(0) & 0x7FFF) << 3, 0], [pixel[2], 0]),
                16 => {
                    let ranges_mm = [word(0) & 0x7_FFFF, word(4) & 0x7_FFFF];
                    (ranges_mm, [pixel[3], pixel[7]])
                }
                _ if profile.header == 0 => {
                    let reflectivity = u16_at(pixel, 4).min(255) as u8;
                    ([word(0) & 0xF_FFFF, 0], [reflectivity, 0])
                }
                _ => ([word(0) & 0x7_FFFF, 0], [pixel[4], 0]),
            };
            each(&Shot { frame, column, row: row as u16, ranges_mm, reflectivities, stamp_ns });
        }
    }

    pub(super) fn decode(
        &mut self,
        payload: &[u8],
        sweep: &mut Sweep,
        on: &mut dyn FnMut(&Revolution),
    ) -> Result<(), Damaged> {
        let Some(first) = self.columns_of(payload).next() else {
            return Err(Damaged);
        };
        let frame = self.frame(payload);
        let place = usize::from(u16_at(first, 8)) / self.columns_per_packet;
        // A packet without a valid column may lie outside of the window.
        let rank = *self.ranks.get(place).ok_or(Damaged)?;
        if let Some(rank) = rank {
            let sequence = u64::from(frame) * self.packets_per_frame + rank;
            sweep.sequence(sequence, self.packets_per_frame << 16);
        }
        match self.last_frame.map(|last| last.wrapping_sub(frame)) {
            Some(0) => {}
            // The frame of this packet has been passed on.
            Some(1..=FRAMES_LATE) => return Ok(()),
            since => {
                let is_whole = since.is_some() && !sweep.was_silent();
                sweep.cut(is_whole, rank.unwrap_or(0) as u32, on);
                self.last_frame = Some(frame);
            }
        }
        for column in self.columns_of(payload) {
            let angle_rad = TAU * (1.0 - f32::from(u16_at(column, 8)) / self.columns as f32);
            let (sin, cos) = angle_rad.sin_cos();
            let mut is_first = true;
            self.column(frame, column, &mut |shot| {
                if std::mem::take(&mut is_first) {
                    sweep.shots(shot.stamp_ns, on);
                }
                sweep.shot(shot.ranges_mm, |slot, sweep| {
                    let xyz_m = self.position_m(shot, slot, sin, cos);
                    sweep.point(xyz_m, shot.reflectivities[slot], shot.stamp_ns);
                });
            });
        }
        Ok(())
    }

    fn position_m(&self, shot: &Shot, slot: usize, sin: f32, cos: f32) -> [f32; 3] {
        let [up, level, turn_sin, turn_cos] = self.rows_sin_cos[usize::from(shot.row)];
        let [out_m, above_m] = self.origin_m;
        // The range is measured from the center of the head.
        let beam_m = shot.ranges_mm[slot] as f32 / 1000.0 - out_m.hypot(above_m);
        let level_m = beam_m * level;
        let in_lidar_m = [
            level_m * (cos * turn_cos - sin * turn_sin) + out_m * cos,
            level_m * (sin * turn_cos + cos * turn_sin) + out_m * sin,
            beam_m * up + above_m,
        ];
        let matrix = self.sensor_from_lidar.as_chunks::<4>().0;
        std::array::from_fn(|i| {
            let [x, y, z, shift_m] = matrix[i];
            x * in_lidar_m[0] + y * in_lidar_m[1] + z * in_lidar_m[2] + shift_m
        })
    }
}

/// Ranks and counts the packets that the sensor sends in a turn: packets with a column in the window. The window's end may lie before its start.
fn ranks(window: [usize; 2], columns: usize, per_packet: usize) -> (Vec<Option<u64>>, u64) {
    let [first, last] = window;
    let is_inside = |column: usize| match first <= last {
        true => (first..=last).contains(&column),
        false => column >= first || column <= last,
    };
    let mut sent = 0;
    let rank = |packet: usize| {
        let mut inside = packet * per_packet..(packet + 1) * per_packet;
        inside.any(is_inside).then(|| {
            sent += 1;
            sent - 1
        })
    };
    let ranks = (0..columns / per_packet).map(rank).collect();
    (ranks, sent.max(1))
}
