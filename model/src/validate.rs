//! Bounds of every field of a manifest: no file may make a stage allocate without limit, index out of range or compute meaningless values.

use crate::error::{ModelError, Result};
use crate::manifest::{AnchorClass, Beams, Manifest, Profiles, RangeBand, Takes, Thresholds};
use crate::network::{DenseLayer, Grid, HeadKind, Network, SparseLayer};
use std::fmt::Display;

/// Cells of the grid and of each sparse layer's output, rows along x in words of 64: bounds the presence bitmaps (1.5 bits per cell, 25 MiB).
const GRID_CELLS_MAX: usize = 1 << 27;
/// Cells of the bird's-eye map; the contract's limit of a features message.
pub const MAP_CELLS_MAX: usize = 131_072;
/// Channels of a feature row; the contract's limit.
pub const FEATURE_CHANNELS_MAX: usize = 512;
/// Known classes; the contract's limit.
pub const CLASSES_MAX: usize = 8;
/// Bytes of a class's name; the contract's limit.
pub const CLASS_NAME_MAX: usize = 32;
/// With one class there are no two prototypes to compare.
const CLASSES_MIN: usize = 2;
/// Boxes after suppression; the contract's limit of a detections message.
pub const BOXES_MAX: u32 = 512;
/// Voxels of a frame, which bound the sites of every sparse layer and so its memory.
pub const VOXELS_MAX: u32 = 131_072;
/// Candidates before suppression; the cost of suppression grows with their square.
const CANDIDATES_MAX: u32 = 16_384;
/// Sizes of class-agnostic anchors.
const GENERIC_MAX: usize = 8;
/// Beams of one range image: they bound its memory.
const BEAMS_MAX: usize = 256;
/// Finest azimuth step: 16,384 columns.
const AZIMUTH_STEP_MIN_RAD: f32 = std::f32::consts::TAU / 16_384.0;
/// Taps of a sparse layer along an axis.
pub const KERNEL_MAX: usize = 7;
/// Channels of any layer.
const CHANNELS_MAX: usize = 1024;
/// Layers of any part.
const LAYERS_MAX: usize = 64;
/// Bands of ranges, each with its own probabilities, and score steps per band.
const RANGE_BANDS_MAX: usize = 16;
const STEPS_MAX: usize = 256;
/// Edge of the grid and of each sparse layer's output, cells: coordinates are u16.
const EDGE_MAX: usize = 65_535;
/// Taps times input channels of a sparse layer: the sum of this many products of u8 and i8 fits an i32.
const INPUTS_MAX: usize = i32::MAX as usize / (255 * 127);
/// Entries of rulebooks and values of all layers, 4 bytes each, at the most sites. SECOND on KITTI's grid: 758 million with [`VOXELS_MAX`].
const NUMBERS_MAX: usize = 1 << 30;

impl Manifest {
    /// Refuses a field that is out of its bounds; the error names the field.
    pub fn validate(&self) -> Result<()> {
        let expected = Manifest::FORMAT;
        require(self.format == expected, "format", expected, self.format)?;
        require(!self.name.is_empty(), "name", "not empty", "''")?;
        self.network.validate()?;
        let (classes, generic) = (self.network.classes, self.network.generic);
        within("classes", self.classes.len(), classes, classes)?;
        within("generic", self.generic.len(), generic, generic)?;
        self.validate_classes()?;
        let values = [
            ("sensor_height_m", self.sensor_height_m, 0.1, 10.0),
            ("prototype_scale", self.prototype_scale, 0.1, 100.0),
            ("empty_objectness_max", self.empty_objectness_max, 0.0, 1.0),
        ];
        bounds("", &values)?;
        self.thresholds.validate()?;
        self.validate_head()?;
        if let Some(takes) = &self.takes {
            takes.validate()?;
        }
        self.beams.validate()
    }

    fn validate_classes(&self) -> Result<()> {
        let all: Vec<&AnchorClass> = self.classes.iter().chain(&self.generic).collect();
        for (number, class) in all.iter().enumerate() {
            let field = match number.checked_sub(self.classes.len()) {
                Some(number) => format!("generic[{number}]"),
                None => format!("classes[{number}]"),
            };
            let first = all.iter().position(|other| other.name == class.name);
            let name = format!("{field}.name");
            require(first == Some(number), &name, "given once", &class.name)?;
            class.validate(&field)?;
        }
        Ok(())
    }

    /// Checks the settings that only some kinds of heads may have.
    fn validate_head(&self) -> Result<()> {
        let (head, t) = (self.network.head, &self.thresholds);
        if let Some(scale) = head.prototype_scale() {
            within("prototype_scale", self.prototype_scale, scale, scale)?;
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

impl Beams {
    /// Refuses beams from which no range image can be made. An empty list is allowed.
    pub fn validate(&self) -> Result<()> {
        let elevations = &self.elevation_rad;
        if elevations.is_empty() {
            return Ok(());
        }
        within("beams.elevation_rad", elevations.len(), 1, BEAMS_MAX)?;
        let mut above = 1.5;
        for (number, &elevation) in elevations.iter().enumerate() {
            let field = format!("beams.elevation_rad[{number}]");
            within(&field, elevation, -1.5, 1.5)?;
            let expected = format_args!("below {above}: from the top down");
            require(elevation < above, &field, expected, elevation)?;
            above = elevation;
        }
        let field = "beams.azimuth_step_rad";
        within(field, self.azimuth_step_rad, AZIMUTH_STEP_MIN_RAD, 0.2)
    }
}

impl Takes {
    fn validate(&self) -> Result<()> {
        let [low, high] = self.beams;
        within("takes.beams[0]", low, 0, high)?;
        let [low, high] = self.points;
        within("takes.points[0]", low, 0, high)?;
        let [low, high] = self.height_m;
        within("takes.height_m[0]", low, 0.05, high)?;
        within("takes.height_m[1]", high, low, 10.0)?;
        within("takes.tilt_max_deg", self.tilt_max_deg, 0.0, 90.0)
    }
}

impl AnchorClass {
    fn validate(&self, field: &str) -> Result<()> {
        let bytes = self.name.len();
        within(&format!("{field}.name: bytes"), bytes, 1, CLASS_NAME_MAX)?;
        for (axis, &size) in self.size_m.iter().enumerate() {
            within(&format!("{field}.size_m[{axis}]"), size, 0.05, 50.0)?;
        }
        let values = [
            ("bottom_z_m", self.bottom_z_m, -100.0, 100.0),
            ("matched_iou", self.matched_iou, 0.0, 1.0),
            ("unmatched_iou", self.unmatched_iou, 0.0, self.matched_iou),
        ];
        bounds(&format!("{field}."), &values)
    }
}

impl Thresholds {
    fn validate(&self) -> Result<()> {
        let field = "thresholds.candidates_max";
        within(field, self.candidates_max, 1, CANDIDATES_MAX)?;
        within("thresholds.boxes_max", self.boxes_max, 1, BOXES_MAX)?;
        let values = [
            ("objectness_min", self.objectness_min, 1e-3, 1.0),
            ("nms_iou", self.nms_iou, 0.0, 1.0),
            ("eds_normalised_max", self.eds_normalised_max, 0.0, 1e6),
            ("softmax_min", self.softmax_min, 0.0, 1.0),
            ("unknown_min", self.unknown_min, 0.0, 1.0),
        ];
        bounds("thresholds.", &values)?;
        for (name, least) in self.profiles.iter().flat_map(Profiles::named) {
            let values = [("known", least.known), ("unknown", least.unknown)];
            let values = values.map(|(kind, score)| (kind, score, 0.0, 1.0));
            bounds(&format!("thresholds.profiles.{name}."), &values)?;
        }
        if let Some(told) = &self.probabilities {
            for (kind, bands) in [("known", &told.known), ("unknown", &told.unknown)] {
                let field = format!("thresholds.probabilities.{kind}");
                within(&field, bands.len(), 0, RANGE_BANDS_MAX)?;
                let mut range_min_m = 0.0;
                for (number, band) in bands.iter().enumerate() {
                    let field = format!("{field}[{number}]");
                    let least_m = std::mem::replace(&mut range_min_m, band.range_min_m);
                    let place = format!("{field}.range_min_m");
                    within(&place, band.range_min_m, least_m, 1e4)?;
                    band.validate(&field)?;
                }
            }
        }
        Ok(())
    }
}

impl RangeBand {
    /// Checks that neither score nor probability decreases.
    fn validate(&self, field: &str) -> Result<()> {
        within(&format!("{field}.steps"), self.steps.len(), 1, STEPS_MAX)?;
        let mut least = [0.0; 2];
        for (number, &step) in self.steps.iter().enumerate() {
            let field = format!("{field}.steps[{number}]");
            within(&format!("{field}[0]"), step[0], least[0], 1.0)?;
            within(&format!("{field}[1]"), step[1], least[1], 1.0)?;
            least = step;
        }
        Ok(())
    }
}

impl Grid {
    fn validate(&self) -> Result<()> {
        for axis in 0..3 {
            let field = |name: &str| format!("network.grid.{name}[{axis}]");
            let (low, high) = (self.range_min_m[axis], self.range_max_m[axis]);
            let size = self.voxel_size_m[axis];
            within(&field("range_min_m"), low, -1e4, 1e4)?;
            within(&field("range_max_m"), high, low, 1e4)?;
            within(&field("voxel_size_m"), size, 1e-3, 1e4)?;
            let cells = (high - low) / size;
            let whole = (cells - cells.round()).abs() < 1e-2;
            let fits = whole && cells.round() >= 1.0;
            let expected = "a whole number of voxels, 1 or more, above range_min_m";
            require(fits, &field("range_max_m"), expected, cells)?;
        }
        validate_shape("network.grid", self.sparse_shape())?;
        let field = "network.grid.points_per_voxel_max";
        within(field, self.points_per_voxel_max, 1, 1000)?;
        within("network.grid.voxels_max", self.voxels_max, 1, VOXELS_MAX)
    }
}

impl Network {
    /// Refuses a network whose layers do not fit each other or the limits.
    pub fn validate(&self) -> Result<()> {
        self.grid.validate()?;
        within("network.sparse", self.sparse.len(), 1, LAYERS_MAX)?;
        within("network.block1", self.block1.len(), 1, LAYERS_MAX)?;
        within("network.block2", self.block2.len(), 1, LAYERS_MAX)?;
        let mut channels = 4;
        let mut shape = self.grid.sparse_shape();
        for (number, layer) in self.sparse.iter().enumerate() {
            let field = format!("network.sparse[{number}]");
            layer.validate(&field, channels, shape)?;
            (channels, shape) = (layer.cout, layer.output_shape(shape));
            validate_shape(&field, shape)?;
        }
        let cells = shape[1] * shape[2];
        within("network: cells of the map", cells, 1, MAP_CELLS_MAX)?;
        let even = shape[1].is_multiple_of(2) && shape[2].is_multiple_of(2);
        let expected = "a map with even edges (block2 halves it, up2 doubles it)";
        require(even, "network", expected, format_args!("{shape:?}"))?;
        let map = self.map_channels();
        within("network: channels of the map", map, 1, CHANNELS_MAX)?;
        let channels = dense_chain("network.block1", &self.block1, map, 1)?;
        within("network.up1.cin", self.up1.cin, channels, channels)?;
        let channels = dense_chain("network.block2", &self.block2, channels, 2)?;
        let sites_max = self.sites_max();
        let sparse = self.sparse.iter().zip(&sites_max[1..]);
        let sparse = sparse.map(|(layer, sites)| sites * (layer.taps() + layer.cout));
        let dense = self.block1.iter().chain(&self.block2);
        let numbers = sparse.chain(dense.map(|layer| cells * layer.cout)).sum();
        within("network: rulebooks and values", numbers, 1, NUMBERS_MAX)?;
        within("network.up2.cin", self.up2.cin, channels, channels)?;
        self.validate_ups()?;
        within("network.classes", self.classes, CLASSES_MIN, CLASSES_MAX)?;
        let is_open = self.head == HeadKind::Open;
        let most = if is_open { GENERIC_MAX } else { 0 };
        within("network.generic", self.generic, 0, most)?;
        let layers = self.block1.len() + self.block2.len();
        let halo_layers = self.halo_layers.unwrap_or(layers);
        // The layer of stride 2 has other cells than the layer before it.
        let least = self.block1.len() + 1;
        within("network.halo_layers", halo_layers, least, layers)?;
        self.validate_names()
    }

    fn validate_ups(&self) -> Result<()> {
        let (up1, up2) = (&self.up1, &self.up2);
        within("network.up1.factor", up1.factor, 1, 1)?;
        within("network.up2.factor", up2.factor, 2, 2)?;
        within("network.up1.cout", up1.cout, 16, FEATURE_CHANNELS_MAX / 2)?;
        // A feature row is then two kernel rows side by side, and consists of whole blocks of 16 channels.
        within("network.up2.cout", up2.cout, up1.cout, up1.cout)?;
        let channels = self.feature_channels();
        let field = "network: channels of a feature row";
        let fits = channels.is_multiple_of(16);
        require(fits, field, "a multiple of 16", channels)
    }

    fn validate_names(&self) -> Result<()> {
        let dense = self.block1.iter().chain(&self.block2);
        let names = self.sparse.iter().map(|layer| &layer.name);
        let names = names.chain(dense.map(|layer| &layer.name));
        let names: Vec<_> = names.chain([&self.up1.name, &self.up2.name]).collect();
        for (number, name) in names.iter().enumerate() {
            let fits = !names[..number].contains(name) && (1..=128).contains(&name.len());
            let field = "network: name of a layer";
            require(fits, field, "unique, 1 to 128 bytes", name)?;
        }
        Ok(())
    }
}

impl SparseLayer {
    fn validate(&self, field: &str, channels: usize, input: [usize; 3]) -> Result<()> {
        within(&format!("{field}.cin"), self.cin, channels, channels)?;
        within(&format!("{field}.cout"), self.cout, 1, CHANNELS_MAX)?;
        for axis in 0..3 {
            let (kernel, padding) = (self.kernel[axis], self.padding[axis]);
            let kernel_field = format!("{field}.kernel[{axis}]");
            within(&kernel_field, kernel, 1, KERNEL_MAX)?;
            within(&format!("{field}.stride[{axis}]"), self.stride[axis], 1, 4)?;
            within(&format!("{field}.padding[{axis}]"), padding, 0, kernel - 1)?;
            let fits = input[axis] + 2 * padding >= kernel;
            let expected = "no larger than its padded input";
            require(fits, &kernel_field, expected, kernel)?;
            let same = !self.submanifold || (kernel == 2 * padding + 1 && self.stride[axis] == 1);
            let expected = "submanifold with stride 1, odd kernel, padding kernel / 2";
            require(same, field, expected, format_args!("{self:?}"))?;
            let reads_own = !self.submanifold && kernel - padding >= self.stride[axis];
            let expected = "floor on a strided layer whose sites read what they stand for";
            require(!self.floor || reads_own, field, expected, "another")?;
        }
        let inputs = self.taps() * self.cin;
        within(&format!("{field}: taps x cin"), inputs, 1, INPUTS_MAX)
    }
}

/// Bounds a grid of z, y, x cells.
fn validate_shape(field: &str, shape: [usize; 3]) -> Result<()> {
    let edge = shape.into_iter().max().unwrap_or(0);
    within(&format!("{field}: longest edge"), edge, 1, EDGE_MAX)?;
    let cells = shape[0] * shape[1] * shape[2].next_multiple_of(64);
    within(&format!("{field}: cells"), cells, 1, GRID_CELLS_MAX)
}

/// Checks a block and returns its output channels.
fn dense_chain(
    field: &str,
    layers: &[DenseLayer],
    mut channels: usize,
    stride: usize,
) -> Result<usize> {
    for (number, layer) in layers.iter().enumerate() {
        let stride = if number == 0 { stride } else { 1 };
        let named = |name: &str| format!("{field}[{number}].{name}");
        within(&named("stride"), layer.stride, stride, stride)?;
        within(&named("cin"), layer.cin, channels, channels)?;
        within(&named("cout"), layer.cout, 1, CHANNELS_MAX)?;
        channels = layer.cout;
    }
    Ok(channels)
}

fn require(holds: bool, field: &str, expected: impl Display, found: impl Display) -> Result<()> {
    if holds {
        return Ok(());
    }
    let (expected, found) = (expected.to_string(), found.to_string());
    Err(ModelError::Field(field.into(), expected, found))
}

/// Checks several fields: name without its `prefix`, value, minimum and maximum.
fn bounds(prefix: &str, values: &[(&str, f32, f32, f32)]) -> Result<()> {
    for &(field, value, low, high) in values {
        within(&format!("{prefix}{field}"), value, low, high)?;
    }
    Ok(())
}

/// Refuses a value out of its bounds, and NaN.
fn within<T: PartialOrd + Display>(field: &str, value: T, low: T, high: T) -> Result<()> {
    let fits = (&low..=&high).contains(&&value);
    if low == high {
        return require(fits, field, low, value);
    }
    require(fits, field, format_args!("{low} to {high}"), value)
}
