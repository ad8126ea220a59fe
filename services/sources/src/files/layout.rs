//! What the numbers of a file mean: which are the coordinates, in what unit, along which axes.

use super::table::{Kind, Table};
use crate::{Scan, SourceError, refused};
use serde::{Deserialize, Serialize};
use smart_default::SmartDefault;
use std::path::PathBuf;

/// Maximum number of rows that are read: more than any scan has, and a limit for files that announce more.
pub(super) const ROWS_MAX: usize = 4 << 20;

/// A coarser step of coordinates is no measurement any more, m.
const STEP_MAX_M: f64 = 0.03;

/// Column names that mean intensity, the usual one first.
const INTENSITIES: [&str; 7] = [
    "intensity",
    "intensities",
    "scalar_intensity",
    "reflectivity",
    "reflectance",
    "remission",
    "i",
];

/// Column names that mean a point's time.
const TIMES: [&str; 5] = ["t", "time", "timestamp", "time_stamp", "offset_time"];
/// Limit for floating-point times: larger values are nanoseconds, smaller ones are seconds.
const SECONDS_MAX: f64 = 1e12;

/// `[layout]`: how to read files of points; the default is KITTI's way where the file itself says nothing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, SmartDefault)]
#[serde(deny_unknown_fields, default)]
pub struct Layout {
    /// Names of the columns of a `.bin` or `.npy` file, which has none; empty: x, y, z, intensity of a `.bin`, and of an `.npy` as many as it has of x, y, z,
    /// intensity, ring, time. Others than x, y, z, intensity and the time are left out.
    pub columns: Vec<String>,
    /// Where the sensor is in the file's coordinates.
    pub origin: [f64; 3],
    /// Metres a unit of the coordinates.
    #[default(1.0)]
    pub scale: f64,
    /// What an intensity is multiplied by, so that it is 0 to 1.
    #[default(1.0)]
    pub intensity_scale: f64,
    /// Which of the file's axes point forward, to the left and up: `y,-x,z`, for instance.
    #[default("x,y,z")]
    pub axes: String,
    /// Calibration of the unit, for captures and live sensors: Velodyne's YAML, Hesai's CSV, Ouster's JSON; unset: the product's own table.
    pub calibration: Option<PathBuf>,
    /// Of a recording, the topic of the scans; unset: the only one that has some.
    pub topic: Option<String>,
    /// Move points to where they are at the scan's stamp, by their times and the sensor's motion.
    pub deskew: bool,
    /// Topic of the motion, in a recording or of ROS 2.
    pub odometry: Option<String>,
    /// Part I (from 0) of N: every Nth scan alone.
    pub shard: Option<[u32; 2]>,
    /// Pose of the sensor in the frame whose motion the odometry tells, as in `[sensor]`.
    #[serde(skip)]
    pub base_from_sensor: [f64; 6],
}

impl Layout {
    /// Checks that every value is in its range. Errors: key, expected and found.
    pub fn check(&self) -> Result<(), SourceError> {
        self.signed_axes()?;
        for (key, value) in [("scale", self.scale), ("intensity_scale", self.intensity_scale)] {
            if !(1e-9..=1e9).contains(&value) {
                return refused(key, "1e-9 to 1e9", value);
            }
        }
        if let Some([index, count]) = self.shard.filter(|[index, count]| index >= count) {
            let found = format!("{index}/{count}");
            return refused("shard", "I/N with I from 0 to N-1", found);
        }
        if !self.origin.iter().all(|v| v.is_finite()) {
            let found = format!("{:?}", self.origin);
            return refused("origin", "three finite numbers", found);
        }
        let is_missing = |axis: &&str| {
            self.columns.iter().filter(|name| name.eq_ignore_ascii_case(axis)).count() != 1
        };
        let missing = ["x", "y", "z"].into_iter().find(is_missing);
        match missing {
            Some(axis) if !self.columns.is_empty() => {
                let found = self.columns.join(",");
                refused("columns", format!("{axis} named once"), found)
            }
            _ => Ok(()),
        }
    }

    /// Names for `count` columns of a file that does not name them.
    pub(super) fn names(&self, count: usize) -> Vec<String> {
        if !self.columns.is_empty() {
            return self.columns.clone();
        }
        let usual = ["x", "y", "z", "intensity", "ring", "time"].map(String::from);
        let others = (usual.len()..).map(|i| format!("column {i}"));
        usual.into_iter().chain(others).take(count).collect()
    }

    /// For forward, left, up: the index of the file's coordinate, and its sign.
    fn signed_axes(&self) -> Result<[(usize, f64); 3], SourceError> {
        let axis = |word: &str| {
            let (sign, name) = word.strip_prefix('-').map_or((1.0, word), |name| (-1.0, name));
            let place = ["x", "y", "z"].iter().position(|axis| *axis == name)?;
            Some((place, sign))
        };
        let words = self.axes.split(',').map(|word| axis(word.trim()));
        let axes: Option<Vec<(usize, f64)>> = words.collect();
        let fault =
            || SourceError::field("axes", "x, y and z once each, as in `y,-x,z`", &self.axes);
        let axes = axes.and_then(|axes| axes.try_into().ok());
        let axes: [(usize, f64); 3] = axes.ok_or_else(fault)?;
        let mut places = axes.map(|(place, _)| place);
        places.sort_unstable();
        let has_all = places == [0, 1, 2];
        has_all.then_some(axes).ok_or_else(fault)
    }

    /// Whether the axes mirror the scan: what is on the left comes out on the right.
    pub(crate) fn mirrors(&self) -> bool {
        self.signed_axes().is_ok_and(|axes @ [first, second, _]| {
            let is_turn = (first.0 + 1) % 3 == second.0;
            let sign: f64 = axes.iter().map(|(_, sign)| sign).product();
            is_turn != (sign > 0.0)
        })
    }

    /// Converts the input's x, y, z to sensor coordinates, m, and its intensity to 0 to 1. Axes that fail the [check](Self::check) stay x, y, z.
    pub(crate) fn placing(&self) -> impl Fn([f64; 4]) -> [f32; 4] {
        let axes = self.signed_axes().unwrap_or([(0, 1.0), (1, 1.0), (2, 1.0)]);
        move |[x, y, z, intensity]| {
            // A missing return stays at the origin.
            let is_none = [x, y, z] == [0.0; 3];
            let from = if is_none { [0.0; 3] } else { self.origin };
            let of = |(place, sign)| ([x, y, z][place] - from[place]) * sign * self.scale;
            let [x, y, z] = axes.map(of);
            [x, y, z, intensity * self.intensity_scale].map(|number| number as f32)
        }
    }

    /// Appends the table's points to the scan as x, y, z (m), intensity, four little-endian f32 per point, and their times if they are requested. Returns
    /// true if the table has fewer rows than it announces.
    pub(super) fn write(&self, table: &Table, scan: &mut Scan) -> Result<bool, SourceError> {
        let placed = self.placing();
        let names = table.columns.iter().map(|column| &*column.name);
        let has = || names.clone().collect::<Vec<_>>().join(", ");
        let column = |name| {
            table
                .column(&[name])
                .ok_or_else(|| SourceError::field("fields", format!("one named {name}"), has()))
        };
        let intensity = table.column(&INTENSITIES);
        let time = table.column(&TIMES).filter(|_| self.deskew);
        let coordinates = [column("x")?, column("y")?, column("z")?];
        let [x, y, z] = coordinates.map(Some);
        let step_m = |i: usize| (self.origin[i] * self.scale).abs() * f64::from(f32::EPSILON);
        let is_coarse = |i: &usize| coordinates[*i].kind == Kind::F32 && step_m(*i) > STEP_MAX_M;
        if let Some(i) = (0..3).find(is_coarse) {
            let found = format!("f32, in steps of {:.2} m at this origin", step_m(i));
            return refused("coordinates", "f64 or integers", found);
        }
        for row in 0..table.rows.min(ROWS_MAX) {
            let value = |column| table.value(column, row);
            let found = [x, y, z, intensity, time].map(|column| column.map_or(Some(0.0), value));
            let [Some(x), Some(y), Some(z), Some(intensity), Some(moment)] = found else {
                return Ok(true);
            };
            if let Some(column) = time {
                // Integer times are nanoseconds.
                let is_float = matches!(column.kind, Kind::Float { .. });
                let is_seconds = is_float && moment.abs() < SECONDS_MAX;
                let unit_ns = if is_seconds { 1e9 } else { 1.0 };
                // A missing return has no time.
                let is_return = [x, y, z] != [0.0; 3] && (x + y + z).is_finite();
                scan.times_ns.push(if is_return { moment * unit_ns } else { f64::NAN });
            }
            let numbers = placed([x, y, z, intensity]).map(f32::to_le_bytes);
            scan.bytes.extend_from_slice(numbers.as_flattened());
        }
        Ok(false)
    }
}
