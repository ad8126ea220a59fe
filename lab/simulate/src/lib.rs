//! Simulated scans of an HDL-64E with labels: a pure function from (family, split, seed, frame) to points and boxes.
//!
//! A frame is laid out (`ground`, `layout`, `background`), merged into one triangle mesh (`scene`), scanned ray by ray (`scan`, `sensor`) and labelled
//! (`labels`). All randomness is a hash of its key, so the bits do not depend on threads or on other frames. Sizes and ranges of objects follow
//! published statistics of KITTI's labels; none of KITTI's data is used.
//!
//! `sim-any` also moves some sensors while they turn, gives some of them second returns, and has rain. Not simulated: snow, fog, physical intensity.

mod background;
mod drawn;
mod drive;
mod ego;
mod export;
mod footprint;
mod ground;
mod labels;
mod layout;
mod mesh;
mod objects;
mod options;
mod place;
mod random;
mod realism;
mod scan;
mod scene;
mod sensor;
pub mod synthetic_unknown;

pub use drawn::rays;
pub use export::export;
pub use mluc_sources::shard;
pub use options::ExportOptions;
pub use realism::Step;

use mluc_dataset::{DatasetError, SYNTHETIC_UNKNOWN};
use mluc_geometry::{Box3, CalibrationError};
use mluc_model::SensorProfile;
use random::Dice;
use std::path::PathBuf;

/// Errors while simulating or writing.
#[derive(Debug, thiserror::Error)]
pub enum SimulateError {
    /// A frame whose scene the ray caster cannot use, and why.
    #[error("frame {0}: the scene's mesh cannot be built: {1}")]
    Mesh(u32, String),
    /// The family's own calibration is not valid.
    #[error("the simulator's calibration is not valid: {0}")]
    Calibration(#[from] CalibrationError),
    /// The output folder, or the options, are not valid.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
}

/// A scenario family: sensor view, sizes, and which classes are known.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, clap::ValueEnum)]
pub enum Family {
    /// Full circle, within 51.2 m; known car, pedestrian, cyclist, truck; unknown golf cart, forklift.
    SimUdi,
    /// Forward half, x up to 70.4 m, |y| up to 40 m, with a camera; known car, pedestrian, cyclist; unknown van, truck.
    SimKitti,
    /// Full circle, 70 m ahead, else within 51.2 m, each frame by another sensor; known car, pedestrian, cyclist; unknown van, truck, golf cart, forklift.
    SimAny,
}

mluc_ipc_types::values!(Family: SimUdi "sim-udi" SimKitti "sim-kitti" SimAny "sim-any");

impl Family {
    /// Classes in training scans.
    pub fn known_classes(self) -> &'static [Class] {
        match self {
            Family::SimUdi => &[Class::Car, Class::Pedestrian, Class::Cyclist, Class::Truck],
            Family::SimKitti | Family::SimAny => &[Class::Car, Class::Pedestrian, Class::Cyclist],
        }
    }

    /// Classes that are never in training scans.
    pub fn unknown_classes(self) -> &'static [Class] {
        match self {
            Family::SimUdi => &[Class::GolfCart, Class::Forklift],
            Family::SimKitti => &[Class::Van, Class::Truck],
            Family::SimAny => &[Class::Van, Class::Truck, Class::GolfCart, Class::Forklift],
        }
    }
}

/// Which part of a data set: splits never share a random stream, so no layout or object is in two of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, clap::ValueEnum)]
pub enum Split {
    /// For training: known classes alone, and synthetic unknown objects where they are asked for.
    Train,
    /// For choosing thresholds.
    Val,
    /// For figures.
    Test,
}

mluc_ipc_types::values!(Split: Train "train" Val "val" Test "test");

/// Class of a labelled object.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Class {
    /// Passenger car.
    Car,
    /// Van.
    Van,
    /// Truck.
    Truck,
    /// Person on foot.
    Pedestrian,
    /// Person on a bicycle.
    Cyclist,
    /// Golf cart.
    GolfCart,
    /// Forklift.
    Forklift,
    /// A class of `unseen.toml`: never in training.
    Unseen(Unseen),
    /// Made of known objects in place of an unknown one: only for training.
    SyntheticUnknown,
}

/// An unseen class, which occurs in only one split, validation or test.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Unseen(u8);

impl Class {
    /// Classes that can be known: all except unseen classes and synthetic unknown objects.
    pub const REAL: [Class; 7] = {
        use Class::*;
        [Car, Van, Truck, Pedestrian, Cyclist, GolfCart, Forklift]
    };

    /// The name in label files.
    pub fn name(self) -> &'static str {
        match self {
            Class::Car => "Car",
            Class::Van => "Van",
            Class::Truck => "Truck",
            Class::Pedestrian => "Pedestrian",
            Class::Cyclist => "Cyclist",
            Class::GolfCart => "Golf_cart",
            Class::Forklift => "Forklift",
            Class::Unseen(class) => class.name(),
            Class::SyntheticUnknown => SYNTHETIC_UNKNOWN,
        }
    }

    fn is_vehicle(self) -> bool {
        matches!(self, Class::Car | Class::Van | Class::Truck)
    }
}

/// One of [`Class::REAL`] by its name, whatever the case of its letters.
impl std::str::FromStr for Class {
    type Err = String;

    fn from_str(text: &str) -> Result<Class, String> {
        let found = Class::REAL.into_iter().find(|c| c.name().eq_ignore_ascii_case(text));
        found.ok_or_else(|| {
            let names = Class::REAL.map(|c| c.name().to_ascii_lowercase());
            format!("expected one of {}, found '{text}'", names.join(", "))
        })
    }
}

/// A labelled object of a simulated frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SimulatedObject {
    /// Its class.
    pub class: Class,
    /// Its box in the sensor frame.
    pub box_in_sensor: Box3,
    /// Number of rays that hit it divided by the number that would hit it if it stood alone, 0..1.
    pub visibility: f32,
    /// Points of the scan inside the box, on any surface.
    pub points: u32,
    /// Left, top, right, bottom of the object's triangles in the image, px, clipped; all 0 outside the image. Without a camera 0 0 100 100.
    pub image_box_px: [f64; 4],
    /// Share of the projected rectangle outside the image, 0..1.
    pub truncated: f64,
    /// Number of the object in the scene: the same in all frames of a sequence.
    pub number: u32,
}

impl SimulatedObject {
    /// KITTI's level: 0 visible, 1 partly, 2 largely occluded, 3 hardly seen. In `sim-udi` fewer than 10 points are level 3 too.
    pub fn occluded(&self, family: Family) -> i32 {
        if family == Family::SimUdi && self.points < 10 {
            return 3;
        }
        [0.75, 0.4, 0.1].into_iter().filter(|least| self.visibility < *least).count() as i32
    }
}

/// A simulated frame.
#[derive(Clone, Debug, PartialEq)]
pub struct SimulatedFrame {
    /// x, y, z (m, sensor frame), intensity 0..1; beam by beam from the top.
    pub points: Vec<[f32; 4]>,
    /// Labelled objects: each has at least one point.
    pub objects: Vec<SimulatedObject>,
    /// Surface of each point: 0 ground, n the n-th object (from 1), 0x8000 and above background, 0x7FFF an object without a label. Only for diagnostics.
    pub instances: Vec<u16>,
    /// Time of each point, s after the turn's end.
    pub times_s: Vec<f32>,
    /// Ground at the sensor: a, b, c, d with a x + b y + c z + d = 0, (a, b, c) upward of length 1, sensor frame.
    pub plane: [f64; 4],
}

/// Position of a frame in a sequence: the scene of one frame, through which the sensor drives while half of the objects move.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Turn {
    /// Index of the turn, from 0, a tenth of a second apart.
    step: u32,
    /// Number of frames of the sequence.
    steps: u32,
    /// Whether the sensor moves while it turns.
    moves: bool,
}

/// Simulates one frame, with the family's sensor where `sensor` is `None`. Pure: the same arguments give the same bits, whatever was simulated before.
pub fn frame(
    family: Family,
    split: Split,
    seed: u64,
    index: u32,
    sensor: Option<&SensorProfile>,
) -> Result<SimulatedFrame, SimulateError> {
    let options = ExportOptions::new(family, split, 1, seed, PathBuf::new());
    let sensor = sensor.cloned();
    Ok(simulated(&ExportOptions { sensor, ..options }, index)?.0)
}

/// A frame, and the sensor's position in the sensor frame of the sequence's first frame (x, y, z, m; its heading stays).
type Shown = (SimulatedFrame, [f64; 3]);

/// The frame of this number in the data set. Its own sensor is mounted, and scans unless `scanned_by` replaces it.
fn simulated(options: &ExportOptions, number: u32) -> Result<Shown, SimulateError> {
    let (family, split, seed) = (options.family, options.split, options.seed);
    let turn =
        options.sequence.map(|steps| Turn { step: number % steps, steps, moves: options.moving });
    // Index of the scene.
    let index = number / options.sequence.unwrap_or(1);
    let (sensor, by) = (options.sensor.as_ref(), options.scanned_by.as_deref());
    let key = random::hash(&[seed, family as u64, split as u64, u64::from(index)]);
    let dice = |stage: u64| Dice::new(&[key, stage]);
    let any = || (family == Family::SimAny).then(|| drawn::sensor(&mut dice(7)));
    let profile = sensor.cloned().or_else(any);
    let drawn = || drawn::height_m(&mut dice(8));
    let height_m = profile.as_ref().map(|p| p.height_m.unwrap_or_else(drawn));
    let ground = ground::Ground::draw(family, height_m, &mut dice(1));
    let on_vehicle = profile.as_ref().filter(|_| family == Family::SimAny);
    let ego = on_vehicle.map(|profile| ego::Ego::draw(profile, &ground, &mut dice(9)));
    let own_ground = ego.as_ref().map_or(ego::CAR, |ego| ego.footprint);
    let mut layout = layout::place_objects(options, &ground, own_ground, &mut dice(2));
    let mut scene = scene::Scene::default();
    scene.add(&ground.mesh(family, &mut dice(3)), 0, |p| p);
    background::fill(&mut layout, &mut scene, &mut dice(4));
    if family == Family::SimAny && turn.is_none() && options.has(Step::Weather) {
        background::weather(&mut layout, &mut scene, &mut dice(11));
    }
    let sensor_key = random::hash(&[key, 5]);
    let is_drawn = sensor.or(by).is_none();
    let mut sensor = match by.or(profile.as_ref()) {
        Some(profile) => sensor::Sensor::of(profile, drawn::JITTER_DEG, sensor_key),
        None => sensor::Sensor::new(sensor_key, family == Family::SimKitti),
    };
    if let (Some(ego), None) = (&ego, turn) {
        let is_merged = profile.as_ref().is_some_and(|p| !p.units.is_empty());
        let stays = is_merged || !ego.mesh.triangles.is_empty();
        let height_m = -ground.height(0.0, 0.0);
        drawn::in_use(&mut sensor, is_drawn, stays, height_m, &mut dice(10));
    }
    let mut sensor_at = mesh::V3::ZERO;
    if let Some(turn) = turn {
        let [at, velocity_mps] = drive::drive(&mut layout, turn, &mut dice(6));
        sensor_at = at;
        sensor.motion = turn.moves.then_some(sensor::Motion {
            velocity_mps,
            yaw_rate_radps: 0.0,
            labels_at_end: true,
        });
        // The sensor keeps its beams, but the noise of its rays changes.
        sensor.key = random::hash(&[sensor.key, turn.step.into()]);
    }
    let mut solids = scene.add_objects(&ground, &layout.placed);
    scene.see_from(sensor_at, &mut solids);
    // The own vehicle would move with the sensor: a sensor that moves while it turns does not see it.
    if let (Some(ego), None) = (&ego, sensor.motion) {
        // In the sensor's frame; the vehicle gets no label.
        scene.add(&ego.mesh, labels::UNLABELLED, |p| p);
    }
    let mesh_error = |reason| SimulateError::Mesh(index, reason);
    let sweep = scan::sweep(&sensor, &scene).map_err(mesh_error)?;
    let camera = labels::calibration(family)?;
    let mut frame = labels::label(&camera, &sensor, &scene, &solids, sweep).map_err(mesh_error)?;
    let (normal, offset) = ground.plane(sensor_at);
    frame.plane = [normal.x, normal.y, normal.z, offset].map(f64::from);
    Ok((frame, sensor_at.to_array().map(f64::from)))
}

#[cfg(test)]
mod tests;
