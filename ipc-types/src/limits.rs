//! The contract's version and all capacities, in one place.

/// Version of everything in this crate; any change of a payload bumps it.
pub const WIRE_VERSION: u32 = 6;
/// Points of one scan; later ones are dropped, counted and flagged.
pub const POINTS_MAX: usize = 262_144;
/// Detections of one frame.
pub const DETECTIONS_MAX: usize = 512;
/// Objects of one frame, suppressed ones included.
pub const OBJECTS_MAX: usize = 512;
/// Point indices over all objects of one frame.
pub const OBJECT_POINTS_MAX: usize = 131_072;
/// Known classes a model may have.
pub const CLASSES_MAX: usize = 8;
/// Corners of a footprint polygon.
pub const FOOTPRINT_MAX: usize = 16;
/// Cells of a model's bird's-eye map.
pub const CELLS_MAX: usize = 131_072;
/// Heights of the ground that follow the feature rows.
pub const GROUND_NODES_MAX: usize = 4096;
/// Channels of a feature row, a multiple of 16.
pub const FEATURE_CHANNELS_MAX: usize = 512;
/// Bytes of a frame's name.
pub const NAME_MAX: usize = 48;
/// Bytes of a model's and a sensor profile's name.
pub const RUN_NAME_MAX: usize = 64;
/// Bytes of a class's name.
pub const CLASS_NAME_MAX: usize = 32;
/// Bytes of the text that says what a score means.
pub const MEANING_MAX: usize = 96;
/// Bytes of the reason of a health report or a status.
pub const REASON_MAX: usize = 192;
