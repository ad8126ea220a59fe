//! Writing simulated frames as a KITTI-format folder.
//!
//! `velodyne/*.bin` (x, y, z, intensity as little-endian f32), `label_2/*.txt`, `calib/*.txt`, `planes/*.txt`, `instances/*.u16` (little-endian, one per point)
//! and `ImageSets/SPLIT.txt`; sequences also `poses.txt` (x, y, z, yaw of the sensor in the frame of the sequence's first scan) and `timestamps.txt`.

use super::{Class, Family, SimulateError, SimulatedFrame, SimulatedObject, Split};
use super::{Step, drawn::rays, labels::calibration, simulated};
use clap::Parser;
use mluc_dataset::{DatasetError, Label, make_folders, scan_bytes, write_file};
use mluc_geometry::{Calibration, limit_period};
use mluc_ipc_types::POINTS_MAX;
use mluc_model::SensorProfile;
use mluc_sources::shard;
use rayon::prelude::*;
use std::path::PathBuf;

/// What to write.
#[derive(Clone, Debug, Parser)]
pub struct ExportOptions {
    /// Scenes: sim-udi (full circle), sim-kitti (forward half, with a camera) or sim-any (full circle, each frame by another sensor).
    #[arg(long, value_enum, hide_possible_values = true)]
    pub family: Family,
    /// train shows known classes alone (see --synthetic-unknown); val and test also unknown ones. No two share a random stream.
    #[arg(long, value_enum, hide_possible_values = true)]
    pub split: Split,
    /// Number of frames.
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub frames: u32,
    /// Seed of the data set.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Scan with this sensor: a product of `sensors/`, or a TOML file like those [default: the family's, of sim-any another in each frame].
    #[arg(long, value_name = "NAME|FILE", value_parser = SensorProfile::load)]
    pub sensor: Option<SensorProfile>,
    /// Scan the same scenes by this sensor too, from the same place, into OUT-pair.
    #[arg(long = "pair", value_name = "NAME|FILE", value_parser = |name: &str| SensorProfile::load(name).map(Box::new), conflicts_with = "sequence")]
    pub scanned_by: Option<Box<SensorProfile>>,
    /// Frames of a sequence at 10 Hz through one scene, in which the sensor and half of the objects move [default: every frame is a scene of its own].
    /// Adds poses.txt and timestamps.txt. The scenes are those of a data set without sequences of the same seed.
    #[arg(long, value_parser = clap::value_parser!(u32).range(2..=100))]
    pub sequence: Option<u32>,
    /// The sensor of a sequence moves while it turns, too. Labels lie where objects are at the turn's end. Adds timed/, the same scans with a fifth column: the
    /// point's time, s after that end, which timestamps.txt and poses.txt give.
    #[arg(long, requires = "sequence")]
    pub moving: bool,
    /// Add synthetic unknown objects, which are known objects resized and joined; their label is Synthetic_unknown. From these
    /// `metric-open` and `mluc-full` learn the unknown. Only for --split train.
    #[arg(long)]
    pub synthetic_unknown: bool,
    /// Show the unseen classes of the split in place of the family's unknown ones; judge with `evaluate model --unknown unseen`. Not for --split train.
    #[arg(long)]
    pub unseen: bool,
    /// Classes that every split shows, train included, in addition to the family's known ones: van, truck, golf_cart, forklift.
    #[arg(long, value_delimiter = ',', value_name = "CLASS,..")]
    pub known: Vec<Class>,
    /// Write part I (0 to N-1) of N alone, for job arrays: every Nth frame. The parts' folders, copied into one, are the whole data set, bit for bit.
    #[arg(long, value_name = "I/N", value_parser = shard, conflicts_with = "sequence")]
    pub shard: Option<[u32; 2]>,
    /// Folder to write; must be new or empty.
    #[arg(long = "out")]
    pub folder: PathBuf,
    /// Leave out kinds of background, to measure their effect (comma separated): confusers (things of a car's size that are not cars), frontage,
    /// furniture, vegetation; of sim-any street and weather too. Not for training a model that is to be used.
    #[arg(long, value_enum, hide_possible_values = true)]
    #[arg(value_delimiter = ',', value_name = "STEP,..")]
    pub without: Vec<Step>,
    /// Go on where the same export was interrupted: frames that are there stay.
    #[arg(skip)]
    pub resume: bool,
}

impl ExportOptions {
    /// Options for separate scenes with every step of realism.
    pub fn new(family: Family, split: Split, frames: u32, seed: u64, folder: PathBuf) -> Self {
        let [family, split] = [family.name(), split.name()];
        let words = format!(
            "simulate --family {family} --split {split} --frames {frames} --seed {seed} --out=."
        );
        let options = ExportOptions::try_parse_from(words.split(' '));
        let options = options.expect("options of the simulator");
        ExportOptions { folder, ..options }
    }

    /// Rejects options that cannot be simulated, and a folder that is not empty unless the export is resumed. Writes nothing.
    pub fn check(&self) -> Result<(), DatasetError> {
        let split = self.split.name();
        if self.synthetic_unknown && self.split != Split::Train {
            let found = format!("{split}: its unknown objects are real ones");
            let place = "synthetic unknown objects";
            return Err(DatasetError::unexpected(place, "the split train", found));
        }
        if self.unseen && self.split == Split::Train {
            let expected = "the split val or test";
            return Err(DatasetError::unexpected("unseen classes", expected, split));
        }
        let is_any = self.family == Family::SimAny;
        let applies = |step: &Step| match step {
            Step::Street => is_any,
            Step::Weather => is_any && self.sequence.is_none(),
            _ => true,
        };
        let is_idle = |step: &Step| !self.has(*step) && !applies(step);
        if let Some(step) = Step::ALL.into_iter().find(is_idle) {
            let steps: Vec<&str> = Step::ALL.into_iter().filter(applies).map(Step::name).collect();
            let expected = format!("steps of these scans ({})", steps.join(", "));
            return Err(DatasetError::unexpected("--without", expected, step.name()));
        }
        for sensor in self.sensor.iter().chain(self.scanned_by.as_deref()) {
            let rays = rays(sensor);
            // An estimated azimuth step may be half a percent too small.
            if rays > 1.01 * POINTS_MAX as f32 {
                let place = format!("sensor {}", sensor.name);
                let expected = format!("at most {POINTS_MAX} rays per scan (beams x columns)");
                let found = format!("{rays:.0}; choose a larger azimuth_step_deg");
                return Err(DatasetError::unexpected(place, expected, found));
            }
        }
        if self.folder.exists() && !self.resume {
            let failed = DatasetError::read(&self.folder);
            let mut entries = std::fs::read_dir(&self.folder).map_err(&failed)?;
            if let Some(entry) = entries.next() {
                let name = entry.map_err(&failed)?.file_name();
                let name = name.display();
                let found = format!("{name} in it; choose another folder or remove it");
                let (place, expected) = (self.folder.display(), "an empty or a new folder");
                return Err(DatasetError::unexpected(place, expected, found));
            }
        }
        Ok(())
    }

    /// Whether the scenes have this kind of background.
    pub fn has(&self, step: Step) -> bool {
        !self.without.contains(&step)
    }

    /// Known classes in addition to the family's, each once.
    pub(crate) fn also_known(&self) -> impl Iterator<Item = Class> {
        let of_family = self.family.known_classes();
        let is_also = |class: &Class| self.known.contains(class) && !of_family.contains(class);
        Class::REAL.into_iter().filter(is_also)
    }

    /// The frames of the part, or all frames.
    pub fn indices(&self) -> Vec<u32> {
        let [index, count] = self.shard.unwrap_or([0, 1]);
        (index..self.frames).step_by(count as usize).collect()
    }
}

/// Writes a data set. `written` is called after each frame, from any thread.
pub fn export(options: &ExportOptions, written: impl Fn() + Sync) -> Result<(), SimulateError> {
    options.check()?;
    let parts = "velodyne label_2 calib planes instances ImageSets".split(' ');
    let parts = parts.chain(options.moving.then_some("timed"));
    make_folders(&options.folder, &parts.collect::<Vec<_>>())?;
    let calibration = calibration(options.family)?;
    let one = |index| {
        // A frame is complete when its last file exists and these files are not empty, which a power cut can cause.
        let has = |file: &str| {
            let path = options.folder.join(file);
            std::fs::metadata(path).is_ok_and(|file| file.len() > 0)
        };
        let files =
            [("planes", "txt"), ("velodyne", "bin"), ("instances", "u16"), ("calib", "txt")];
        let mut files = files.map(|(part, end)| format!("{part}/{index:06}.{end}")).into_iter();
        if options.resume && files.all(|file| has(&file)) {
            written();
            return Ok([0.0; 3]);
        }
        let (frame, pose) = simulated(options, index)?;
        write_frame(options, &calibration, index, &frame)?;
        written();
        Ok(pose)
    };
    let poses = options.indices().into_par_iter().map(one);
    write_poses(options, &poses.collect::<Result<Vec<_>, SimulateError>>()?)?;
    let names: String = (0..options.frames).map(|i| format!("{i:06}\n")).collect();
    let list = format!("ImageSets/{}.txt", options.split.name());
    let list = options.folder.join(list);
    Ok(write_file(&list, names.as_bytes())?)
}

/// Poses and time stamps of sequences. Each sequence is another place, one kilometre further, so that no place is visited twice.
fn write_poses(options: &ExportOptions, poses: &[[f64; 3]]) -> Result<(), DatasetError> {
    let Some(steps) = options.sequence else {
        return Ok(());
    };
    let mut text = String::from("# x y z yaw (m, rad)\n");
    let mut stamps = String::new();
    for (index, [x, y, z]) in poses.iter().enumerate() {
        let sequence = index / steps as usize;
        text += &format!("{} {y} {z} 0\n", x + 1000.0 * sequence as f64);
        let (seconds, tenths) = (index / 10, index % 10);
        let (h, m, s) = (seconds / 3600 % 24, seconds / 60 % 60, seconds % 60);
        stamps += &format!("2000-01-01 {h:02}:{m:02}:{s:02}.{tenths}00000000\n");
    }
    write_file(&options.folder.join("poses.txt"), text.as_bytes())?;
    write_file(&options.folder.join("timestamps.txt"), stamps.as_bytes())
}

fn write_frame(
    options: &ExportOptions,
    calibration: &Calibration,
    index: u32,
    frame: &SimulatedFrame,
) -> Result<(), DatasetError> {
    let label = |object: &SimulatedObject| {
        let mut label = label_of(object, options.family, calibration);
        // Another sequence has other objects.
        let scene = options.sequence.map(|steps| index / steps);
        label.track = scene.map(|scene| scene * OBJECTS_MAX + object.number);
        format!("{label}\n")
    };
    let labels: String = frame.objects.iter().map(label).collect();
    let instances = frame.instances.iter().flat_map(|i| i.to_le_bytes());
    let calib = calibration_text(calibration);
    let plane = plane_text(calibration, frame.plane);
    let files = [
        ("velodyne", "bin", scan_bytes(&frame.points)),
        ("instances", "u16", instances.collect()),
        ("label_2", "txt", labels.into_bytes()),
        ("calib", "txt", calib.into_bytes()),
        ("planes", "txt", plane.into_bytes()),
    ];
    let rows = frame.points.iter().zip(&frame.times_s);
    let rows = rows.flat_map(|([x, y, z, i], time_s)| [*x, *y, *z, *i, *time_s]);
    let timed = rows.flat_map(f32::to_le_bytes);
    let timed = options.moving.then(|| ("timed", "bin", timed.collect()));
    for (folder, extension, bytes) in files.iter().chain(&timed) {
        let file = format!("{folder}/{index:06}.{extension}");
        write_file(&options.folder.join(file), bytes)?;
    }
    Ok(())
}

/// Upper bound on the number of objects in a scene.
const OBJECTS_MAX: u32 = 1000;

/// The label line of an object.
fn label_of(object: &SimulatedObject, family: Family, calibration: &Calibration) -> Label {
    let camera_box = calibration.label_from_box_in_sensor(&object.box_in_sensor);
    let [x, _, z] = camera_box.location_m;
    let alpha_rad = camera_box.rotation_y_rad - x.atan2(z);
    Label {
        class: object.class.name().to_owned(),
        truncated: object.truncated,
        occluded: object.occluded(family),
        alpha_rad: limit_period(alpha_rad, 0.5, std::f64::consts::TAU),
        image_box_px: object.image_box_px,
        camera_box,
        ..Label::default()
    }
}

fn calibration_text(calibration: &Calibration) -> String {
    const IDENTITY: &[f64] = &[1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0.];
    let [p2, r0_rect, velo_to_cam] = calibration.matrices();
    let line = |(name, values): (&str, &[f64])| {
        let values: String = values.iter().map(|value| format!(" {value}")).collect();
        format!("{name}:{values}\n")
    };
    let cameras = ["P0", "P1", "P2", "P3"].map(|name| line((name, p2.1)));
    let rest = [r0_rect, velo_to_cam, ("Tr_imu_to_velo", IDENTITY)].map(line);
    cameras.concat() + &rest.concat()
}

/// The ground plane in the camera frame, in the layout of the road planes published for KITTI.
fn plane_text(calibration: &Calibration, [a, b, c, d]: [f64; 4]) -> String {
    // The ends of the normal, transformed to the camera frame. The normal has length 1 only to f32 precision.
    let [origin, tip] = [[0.0; 3], [a, b, c]].map(|p| calibration.rect_from_sensor(p));
    let [x, y, z] = [0, 1, 2].map(|i| tip[i] - origin[i]);
    let offset = d - (x * origin[0] + y * origin[1] + z * origin[2]);
    let length = x.hypot(y).hypot(z);
    let [x, y, z, offset] = [x, y, z, offset].map(|v| v / length);
    format!("# Plane\nWidth 4\nHeight 1\n{x:.6e} {y:.6e} {z:.6e} {offset:.6e}\n")
}
