//! Bounds of every field of a manifest: a file from anywhere must not make a stage allocate without limit, index out of
//! range or compute nonsense.

use crate::error::ModelError;
use crate::manifest::{AnchorClass, Manifest, Thresholds};
use crate::network::{DenseLayer, Grid, HeadKind, Network, SparseLayer};

/// Voxels of the grid: bounds the presence bitmaps (a bit and half a bit more for each, 25 MiB).
pub const GRID_CELLS_MAX: usize = 1 << 27;
/// Cells of the bird's-eye map; the contract's limit of a features message.
pub const MAP_CELLS_MAX: usize = 131_072;
/// Channels of a feature row; the contract's limit.
pub const FEATURE_CHANNELS_MAX: usize = 512;
/// Known classes; the contract's limit.
pub const CLASSES_MAX: usize = 8;
/// With one class there is nothing between the prototypes.
const CLASSES_MIN: usize = 2;
/// Boxes after suppression; the contract's limit of a detections message.
pub const BOXES_MAX: u32 = 512;
/// Voxels of a frame: more than the contract's points of a scan have no use.
pub const VOXELS_MAX: u32 = 131_072;
/// Candidates before suppression, whose cost grows with the square.
pub const CANDIDATES_MAX: u32 = 16_384;
/// Anchors without a class.
const GENERIC_MAX: usize = 8;
/// Channels of any layer.
const CHANNELS_MAX: usize = 1024;
/// Layers of any part.
const LAYERS_MAX: usize = 64;
/// Edge of the grid in voxels: coordinates are u16.
const EDGE_MAX: f32 = 65_535.0;

impl Manifest {
    /// Refuses a field out of its bounds, by name.
    pub fn validate(&self) -> Result<(), ModelError> {
        require(
            self.format == Manifest::FORMAT,
            "format",
            Manifest::FORMAT,
            self.format,
        )?;
        require(!self.name.is_empty(), "name", "not empty", "''")?;
        self.network.validate()?;
        let classes = self.network.classes;
        require(
            self.classes.len() == classes,
            "classes",
            format!("{classes} (network.classes)"),
            self.classes.len(),
        )?;
        let generic = self.network.generic;
        require(
            self.generic.len() == generic,
            "generic",
            format!("{generic} (network.generic)"),
            self.generic.len(),
        )?;
        let all: Vec<&AnchorClass> = self.classes.iter().chain(&self.generic).collect();
        for (number, class) in all.iter().enumerate() {
            let first = all.iter().position(|other| other.name == class.name);
            let field = match number.checked_sub(classes) {
                Some(number) => format!("generic[{number}]"),
                None => format!("classes[{number}]"),
            };
            require(
                first == Some(number),
                &format!("{field}.name"),
                "given once",
                &class.name,
            )?;
            class.validate(&field)?;
        }
        between("sensor_height_m", self.sensor_height_m, 0.1, 10.0)?;
        between("prototype_scale", self.prototype_scale, 0.1, 100.0)?;
        between("empty_objectness_max", self.empty_objectness_max, 0.0, 1.0)?;
        self.thresholds.validate()?;
        self.validate_head()?;
        require(
            self.beams.elevation_rad.len() <= 1024,
            "beams.elevation_rad",
            "at most 1024",
            self.beams.elevation_rad.len(),
        )?;
        for (number, &elevation) in self.beams.elevation_rad.iter().enumerate() {
            between(
                &format!("beams.elevation_rad[{number}]"),
                elevation,
                -1.6,
                1.6,
            )?;
        }
        between(
            "beams.azimuth_step_rad",
            self.beams.azimuth_step_rad,
            0.0,
            1.0,
        )
    }
}

impl Manifest {
    /// What only some kinds of heads may say.
    fn validate_head(&self) -> Result<(), ModelError> {
        let (head, t) = (self.network.head, &self.thresholds);
        if let Some(scale) = head.prototype_scale() {
            between("prototype_scale", self.prototype_scale, scale, scale)?;
        }
        let (closed, open) = (head == HeadKind::Sigmoid, head == HeadKind::Open);
        let gate = [
            ("eds_normalised_max", t.eds_normalised_max, !closed),
            ("softmax_min", t.softmax_min, !closed),
            ("unknown_min", t.unknown_min, open),
        ];
        for (field, value, may_be_set) in gate {
            let fits = may_be_set || value == 0.0;
            let expected = format_args!("0 with a {head:?} head");
            require(fits, &format!("thresholds.{field}"), expected, value)?;
        }
        Ok(())
    }
}

impl AnchorClass {
    fn validate(&self, field: &str) -> Result<(), ModelError> {
        require(
            !self.name.is_empty() && self.name.len() <= 64,
            &format!("{field}.name"),
            "1 to 64 bytes",
            &self.name,
        )?;
        for (axis, &size) in self.size_m.iter().enumerate() {
            between(&format!("{field}.size_m[{axis}]"), size, 0.05, 50.0)?;
        }
        between(
            &format!("{field}.bottom_z_m"),
            self.bottom_z_m,
            -100.0,
            100.0,
        )?;
        between(&format!("{field}.matched_iou"), self.matched_iou, 0.0, 1.0)?;
        between(
            &format!("{field}.unmatched_iou"),
            self.unmatched_iou,
            0.0,
            self.matched_iou,
        )
    }
}

impl Thresholds {
    fn validate(&self) -> Result<(), ModelError> {
        between("thresholds.objectness_min", self.objectness_min, 1e-3, 1.0)?;
        between(
            "thresholds.candidates_max",
            self.candidates_max as f32,
            1.0,
            CANDIDATES_MAX as f32,
        )?;
        between("thresholds.nms_iou", self.nms_iou, 0.0, 1.0)?;
        between(
            "thresholds.boxes_max",
            self.boxes_max as f32,
            1.0,
            BOXES_MAX as f32,
        )?;
        between(
            "thresholds.eds_normalised_max",
            self.eds_normalised_max,
            0.0,
            1e6,
        )?;
        between("thresholds.softmax_min", self.softmax_min, 0.0, 1.0)?;
        between("thresholds.unknown_min", self.unknown_min, 0.0, 1.0)
    }
}

impl Grid {
    fn validate(&self) -> Result<(), ModelError> {
        for axis in 0..3 {
            let field = |name: &str| format!("network.grid.{name}[{axis}]");
            let (low, high, size) = (
                self.range_min_m[axis],
                self.range_max_m[axis],
                self.voxel_size_m[axis],
            );
            between(&field("range_min_m"), low, -1e4, 1e4)?;
            between(&field("range_max_m"), high, low, 1e4)?;
            between(&field("voxel_size_m"), size, 1e-3, 1e4)?;
            let cells = (high - low) / size;
            let whole =
                (cells - cells.round()).abs() < 1e-2 && (1.0..EDGE_MAX).contains(&cells.round());
            require(
                whole,
                &field("range_max_m"),
                "a whole number of voxels (1 to 65,534) above range_min_m",
                cells,
            )?;
        }
        let cells = self.sparse_shape().iter().product::<usize>();
        require(
            cells <= GRID_CELLS_MAX,
            "network.grid",
            format!("at most {GRID_CELLS_MAX} voxels"),
            cells,
        )?;
        between(
            "network.grid.points_per_voxel_max",
            self.points_per_voxel_max as f32,
            1.0,
            1000.0,
        )?;
        between(
            "network.grid.voxels_max",
            self.voxels_max as f32,
            1.0,
            VOXELS_MAX as f32,
        )
    }
}

impl Network {
    /// Refuses a network whose layers do not fit each other or the limits.
    pub fn validate(&self) -> Result<(), ModelError> {
        self.grid.validate()?;
        for (part, layers) in [
            ("sparse", self.sparse.len()),
            ("block1", self.block1.len()),
            ("block2", self.block2.len()),
        ] {
            count(&format!("network.{part}"), layers, 1, LAYERS_MAX)?;
        }
        let mut channels = 4;
        let mut shape = self.grid.sparse_shape();
        for (number, layer) in self.sparse.iter().enumerate() {
            layer.validate(&format!("network.sparse[{number}]"), channels, shape)?;
            (channels, shape) = (layer.cout, layer.output_shape(shape));
        }
        let cells = shape[1] * shape[2];
        require(
            cells <= MAP_CELLS_MAX,
            "network",
            format!("a map of at most {MAP_CELLS_MAX} cells"),
            cells,
        )?;
        let even = shape[1].is_multiple_of(2) && shape[2].is_multiple_of(2);
        require(
            even,
            "network",
            "a map with even edges (block2 halves it, up2 doubles it)",
            format!("{shape:?}"),
        )?;
        count(
            "network: channels of the map",
            self.map_channels(),
            1,
            CHANNELS_MAX,
        )?;
        let channels = dense_chain("network.block1", &self.block1, self.map_channels(), 1)?;
        count("network.up1.cin", self.up1.cin, channels, channels)?;
        let channels = dense_chain("network.block2", &self.block2, channels, 2)?;
        count("network.up2.cin", self.up2.cin, channels, channels)?;
        self.validate_ups()?;
        // The unknown logit of an open head is handed on after the embedding, in the same list.
        let (open, reserved) = (
            self.head == HeadKind::Open,
            usize::from(self.head == HeadKind::Open),
        );
        count(
            "network.classes",
            self.classes,
            CLASSES_MIN,
            CLASSES_MAX - reserved,
        )?;
        let generic_max = if open { GENERIC_MAX } else { 0 };
        count("network.generic", self.generic, 0, generic_max)?;
        self.validate_names()
    }

    fn validate_ups(&self) -> Result<(), ModelError> {
        count("network.up1.factor", self.up1.factor, 1, 1)?;
        count("network.up2.factor", self.up2.factor, 2, 2)?;
        count(
            "network.up1.cout",
            self.up1.cout,
            16,
            FEATURE_CHANNELS_MAX / 2,
        )?;
        // A feature row is then two kernel rows side by side, and whole blocks of 16 channels.
        count(
            "network.up2.cout",
            self.up2.cout,
            self.up1.cout,
            self.up1.cout,
        )?;
        let blocks = self.feature_channels().is_multiple_of(16);
        require(
            blocks,
            "network: channels of a feature row",
            "a multiple of 16",
            self.feature_channels(),
        )
    }

    fn validate_names(&self) -> Result<(), ModelError> {
        let dense = self
            .block1
            .iter()
            .chain(&self.block2)
            .map(|layer| &layer.name);
        let names = self.sparse.iter().map(|layer| &layer.name).chain(dense);
        let names: Vec<_> = names.chain([&self.up1.name, &self.up2.name]).collect();
        for (number, name) in names.iter().enumerate() {
            let fresh = !names[..number].contains(name);
            require(
                fresh && !name.is_empty() && name.len() <= 128,
                "network: name of a layer",
                "unique, 1 to 128 bytes",
                name,
            )?;
        }
        Ok(())
    }
}

impl SparseLayer {
    fn validate(&self, field: &str, channels: usize, input: [usize; 3]) -> Result<(), ModelError> {
        count(&format!("{field}.cin"), self.cin, channels, channels)?;
        count(&format!("{field}.cout"), self.cout, 1, CHANNELS_MAX)?;
        for axis in 0..3 {
            let (kernel, padding) = (self.kernel[axis], self.padding[axis]);
            count(&format!("{field}.kernel[{axis}]"), kernel, 1, 7)?;
            count(&format!("{field}.stride[{axis}]"), self.stride[axis], 1, 4)?;
            count(&format!("{field}.padding[{axis}]"), padding, 0, kernel - 1)?;
            let fits = input[axis] + 2 * padding >= kernel;
            require(
                fits,
                &format!("{field}.kernel[{axis}]"),
                "no larger than its padded input",
                kernel,
            )?;
            let same = !self.submanifold || (kernel == 2 * padding + 1 && self.stride[axis] == 1);
            require(
                same,
                field,
                "submanifold with stride 1, odd kernel, padding kernel / 2",
                format!("{self:?}"),
            )?;
        }
        Ok(())
    }
}

/// Checks a block and gives its output channels.
fn dense_chain(
    field: &str,
    layers: &[DenseLayer],
    channels: usize,
    stride: usize,
) -> Result<usize, ModelError> {
    let mut channels = channels;
    for (number, layer) in layers.iter().enumerate() {
        let stride = if number == 0 { stride } else { 1 };
        count(
            &format!("{field}[{number}].stride"),
            layer.stride,
            stride,
            stride,
        )?;
        count(
            &format!("{field}[{number}].cin"),
            layer.cin,
            channels,
            channels,
        )?;
        count(
            &format!("{field}[{number}].cout"),
            layer.cout,
            1,
            CHANNELS_MAX,
        )?;
        channels = layer.cout;
    }
    Ok(channels)
}

fn require(
    holds: bool,
    field: &str,
    expected: impl std::fmt::Display,
    found: impl std::fmt::Display,
) -> Result<(), ModelError> {
    if holds {
        return Ok(());
    }
    Err(ModelError::Field {
        field: field.into(),
        expected: expected.to_string(),
        found: found.to_string(),
    })
}

/// Also refuses NaN.
fn between(field: &str, value: f32, low: f32, high: f32) -> Result<(), ModelError> {
    require(
        (low..=high).contains(&value),
        field,
        format_args!("between {low} and {high}"),
        value,
    )
}

fn count(field: &str, value: usize, low: usize, high: usize) -> Result<(), ModelError> {
    if low == high {
        return require(value == low, field, low, value);
    }
    require(
        (low..=high).contains(&value),
        field,
        format_args!("{low} to {high}"),
        value,
    )
}
