//! The mismatches. Their texts say what was found, what was expected, and what to do.

use crate::estimate::{Unit, Up};
use mluc_ipc_types::Flags;

/// A mismatch. Its text says what was found, what was expected, and what to do.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Reason {
    /// Share of the points that have no measurement of their own; which points these are; the remedy.
    #[error("{:.0} % of the points {}, expected at most {:.0} %: {}", .0 * 100.0, .1, SHARE_MAX * 100.0, .2)]
    Share(f32, &'static str, &'static str),
    /// Points per scan; the fewest and the most expected.
    #[error("{} points per scan, expected {} to {}: are scans cut into packets, or several put together?", .0, .1[0], .1[1])]
    Points(u32, [u32; 2]),
    /// The coordinates are not in metres: their unit.
    #[error("coordinates seem to be in {}, expected m: read them with --scale {}", .0.name(), .0.in_m())]
    Unit(Unit),
    /// Range below which half of the returns lie, m, and the least expected.
    #[error("half of the returns lie within {:.3} m, expected more than {:.1} m: in another unit, or scaled twice? --scale says how long a unit is, in m", .0, .1)]
    Near(f32, f32),
    /// Range beyond which nearly all returns lie, in the scan's unit.
    #[error("nearly all returns lie {:.0} or more away, to one side, above or below: in map coordinates? --origin X,Y,Z says where the sensor is", .0)]
    Map(f32),
    /// The coordinates may be in feet: depth of the ground below the sensor, read as m; the lowest and the highest expected height of the sensor.
    #[error("the ground lies {:.1} below the sensor, expected {:.1} to {:.1} m: if the coordinates are in feet, read them with --scale 0.3048, else mount it there or take a model for this height", .0, .1[0], .1[1])]
    Feet(f32, [f32; 2]),
    /// Another axis than z points up.
    #[error("{} points up, expected z: say with --axes which axes point ahead, to the left and up{}", .0.name(), if .0.name() == "-z" { " (x,-y,-z for a sensor upside down)" } else { "" })]
    Axes(Up),
    /// Height of the sensor, m; the lowest and the highest expected.
    #[error("sensor {:.2} m above the ground, expected {:.2} to {:.2} m: mount it there, shift z with --origin 0,0,Z (Z is subtracted), or take a model for this height", .0, .1[0], .1[1])]
    Height(f32, [f32; 2]),
    /// Tilt of the sensor, degrees; the largest expected.
    #[error("sensor tilted by {:.0} degrees, expected at most {:.0}: level it, or turn the points by its extrinsics", .0, .1)]
    Tilt(f32, f32),
    /// Beams found; the fewest and the most that the model takes.
    #[error("{} beams, expected {} to {}: take a model for this sensor", .0, .1[0], .1[1])]
    Beams(u32, [u32; 2]),
    /// Width of a gap in the field, degrees.
    #[error("no returns in {:.0} degrees of the directions that the model sees: uncover the sensor, or name its field with --sensor", .0)]
    Field(f32),
    /// Distance at which a driver's range limit ends the returns, and the least distance expected, m.
    #[error("returns end {:.0} m away in nearly half of the directions, expected {:.0} m or more: raise the driver's range limit", .0, .1)]
    Range(f32, f32),
    /// The largest intensity, above 1.
    #[error("intensities up to {}, expected 0 to 1: {}", (.0.min(1e6) * 100.0).ceil() / 100.0, intensity_remedy(*.0))]
    IntensityScale(f32),
    /// All intensities are 0, and the model reads intensities.
    #[error(
        "all intensities are 0, expected 0 to 1: let the driver send them, or take a model that does not read them"
    )]
    IntensityMissing,
    /// How often the same scan came in a row.
    #[error("the same scan came {0} times, expected new ones: check the driver and the source")]
    Frozen(u32),
    /// Not the given sensor's beams: number found; degrees off (mean of the beams, or excess over the vertical field); number in the profile.
    #[error("{} beams, {:.1} degrees off those of the given sensor, expected its {}: give the right --sensor", .0, .1, .2)]
    SensorBeams(u32, f32, u32),
    /// Returns beyond the given sensor's range: their distance and that range, m.
    #[error("returns {:.0} away, expected at most {:.0} m by the given sensor: correct its range_m, or, if the coordinates are in feet, read them with --scale 0.3048", .0, .1)]
    SensorRange(f32, f32),
    /// Not the given sensor's height: found and given, m.
    #[error("sensor {:.2} m above the ground, expected {:.2} m by the given sensor: correct its height_m", .0, .1)]
    SensorHeight(f32, f32),
    /// Not the given sensor's azimuth step: found and given, degrees.
    #[error("columns {:.2} degrees apart, expected {:.2} by the given sensor: correct its azimuth_step_deg", .0, .1)]
    SensorStep(f32, f32),
    /// Returns outside of the given sensor's horizontal field: by up to how many degrees.
    #[error("returns up to {:.0} degrees outside of the horizontal field of the given sensor, expected none: correct its field_deg", .0)]
    SensorField(f32),
}

/// A larger share of points without a measurement is a fault, not a few wrong returns; a guess.
pub(super) const SHARE_MAX: f32 = 0.25;

impl Reason {
    /// The flag that this reason sets on the frame; it includes [`Flags::INPUT_SUSPECT`].
    pub fn flag(&self) -> Flags {
        match self {
            Reason::Share(..) | Reason::Points(..) => Flags::SUSPECT_POINTS,
            Reason::Unit(_) | Reason::Near(..) | Reason::Map(_) | Reason::Feet(..) => {
                Flags::SUSPECT_UNIT
            }
            Reason::Axes(_) => Flags::SUSPECT_AXES,
            Reason::Height(..) => Flags::SUSPECT_HEIGHT,
            Reason::Tilt(..) => Flags::SUSPECT_TILT,
            Reason::Beams(..) => Flags::SUSPECT_BEAMS,
            Reason::Field(_) => Flags::SUSPECT_FIELD,
            Reason::Range(..) => Flags::SUSPECT_RANGE,
            Reason::IntensityScale(_) | Reason::IntensityMissing => Flags::SUSPECT_INTENSITY,
            Reason::Frozen(_) => Flags::SUSPECT_FROZEN,
            Reason::SensorBeams(..)
            | Reason::SensorRange(..)
            | Reason::SensorHeight(..)
            | Reason::SensorStep(..)
            | Reason::SensorField(_) => Flags::SUSPECT_SENSOR,
        }
    }
}

/// What to do about a largest intensity. One that fits no usual scale is rather another quantity.
fn intensity_remedy(most: f32) -> &'static str {
    match most {
        90.0..=255.5 => "read them with --intensity-scale 0.00392",
        255.5..=65_535.5 => "read them with --intensity-scale 0.0000153",
        _ => {
            "is the fourth number the intensity? --columns names the columns, --intensity-scale scales it"
        }
    }
}
