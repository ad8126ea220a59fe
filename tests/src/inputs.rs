//! Models and scans, made up, and a pipeline on them.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde_json::Value;
use tempfile::TempDir;

use crate::pipeline::{Finished, Pipeline, leftovers, unique_instance};
use mluc_model::{Grid, Manifest, Network, formula_weights, model_bytes};

/// Writes a model with weights by formula, small and quick: it sees shapes and no sense. Its gate calls half of its
/// boxes candidates, so that all stages have work.
pub fn untrained_model(folder: &Path) -> PathBuf {
    let network = Network::compact(Grid::kitti_compact(), 3);
    let weights = formula_weights(&network);
    let mut manifest = Manifest::untrained("untrained", network);
    manifest.thresholds.objectness_min = 0.6;
    manifest.thresholds.boxes_max = 40;
    manifest.thresholds.eds_normalised_max = 1.5;
    let path = folder.join("untrained.safetensors");
    fs::write(
        &path,
        model_bytes(&manifest, &weights).expect("a sound model"),
    )
    .expect("a writable folder");
    path
}

/// Ground around the sensor and a car-sized box `distance_m` ahead, about 20,000 points.
pub fn car_scan(distance_m: f32) -> Vec<[f32; 4]> {
    let mut points = Vec::new();
    for ring in 0..60 {
        let range = 4.0 + ring as f32 * 0.7;
        points.extend((0..300).map(|step| {
            let angle = (step as f32 - 150.0) * 0.005;
            [range * angle.cos(), range * angle.sin(), -1.73, 0.3]
        }));
    }
    for column in 0..40 {
        points.extend((0..15).map(|row| {
            let (y, z) = (-0.9 + column as f32 * 0.045, -1.6 + row as f32 * 0.1);
            [distance_m, y, z, 0.6]
        }));
    }
    points
}

/// Writes KITTI's `.bin`.
pub fn write_scan(path: &Path, points: &[[f32; 4]]) {
    let bytes: Vec<u8> = points
        .iter()
        .flatten()
        .flat_map(|v| v.to_le_bytes())
        .collect();
    fs::write(path, bytes).expect("a writable folder");
}

/// A folder of `count` sound scans, 000000.bin and so on.
pub fn clean_folder(folder: &Path, count: usize) -> PathBuf {
    let input = folder.join("scans");
    fs::create_dir_all(&input).expect("a writable folder");
    for number in 0..count {
        write_scan(
            &input.join(format!("{number:06}.bin")),
            &car_scan(8.0 + number as f32),
        );
    }
    input
}

/// What a test of a pipeline needs: a folder, the untrained model and sound scans in it, and a name for the instance.
pub struct Setting {
    /// Gone with the setting.
    pub folder: TempDir,
    /// [`untrained_model`].
    pub model: PathBuf,
    /// [`clean_folder`].
    pub input: PathBuf,
    /// Of this setting alone.
    pub instance: String,
}

impl Setting {
    /// With so many scans.
    pub fn new(label: &str, scans: usize) -> Setting {
        let folder = tempfile::tempdir().expect("a writable folder");
        Setting {
            model: untrained_model(folder.path()),
            input: clean_folder(folder.path(), scans),
            instance: unique_instance(label),
            folder,
        }
    }

    /// `mluc up` at pace `complete`; another `--pace` wins.
    pub fn up(&self, more: &[&str]) -> Pipeline {
        let pace = if more.contains(&"--pace") {
            &[][..]
        } else {
            &["--pace", "complete"]
        };
        let arguments = [pace, more].concat();
        Pipeline::up(&self.instance, &self.model, &self.input, &arguments)
    }

    /// The same to its end, after which nothing is left in shared memory.
    pub fn run(&self, more: &[&str]) -> Finished {
        self.finish(self.up(more))
    }

    /// Waits for the end of a pipeline of this setting; nothing is left of it in shared memory.
    pub fn finish(&self, run: Pipeline) -> Finished {
        let run = run.finish();
        assert_eq!(leftovers(&self.instance), [""; 0], "{}", run.log);
        run
    }

    /// Writes `mluc.toml` and gives its path.
    pub fn config(&self, text: &str) -> String {
        let path = self.folder.path().join("mluc.toml");
        fs::write(&path, text).expect("a writable folder");
        path.display().to_string()
    }

    /// Where [`Setting::bench`] has its report written.
    pub fn report(&self) -> PathBuf {
        self.folder.path().join("report")
    }

    /// Starts `mluc bench` on the setting's scans, with options as on a command line.
    pub fn start_bench(&self, options: &str) -> Pipeline {
        let paths =
            [&self.model, &self.input, &self.report()].map(|path| path.display().to_string());
        let names = ["--model", "--input", "--out"];
        let own = names
            .iter()
            .zip(&paths)
            .flat_map(|(name, path)| [*name, path]);
        Pipeline::start(
            ["bench"]
                .into_iter()
                .chain(own)
                .chain(options.split_whitespace()),
        )
    }

    /// The same to its end; it must succeed, at most with warnings.
    pub fn bench(&self, options: &str) -> Finished {
        let run = self
            .start_bench(options)
            .finish_within(Duration::from_secs(180));
        assert!(matches!(run.code, Some(0 | 3)), "{}", run.log);
        run
    }
}

/// A JSON file.
pub fn read_json(path: &Path) -> Value {
    let text = fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    serde_json::from_str(&text).expect("JSON")
}
