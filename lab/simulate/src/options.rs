//! What to simulate.

use super::{Class, Family, Split, Step, drawn::rays};
use clap::Parser;
use mluc_dataset::DatasetError;
use mluc_ipc_types::POINTS_MAX;
use mluc_model::SensorProfile;
use mluc_sources::shard;
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
