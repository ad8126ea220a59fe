//! Synthetic models and scans, and a pipeline that runs on them.

use crate::running::{Finished, Running, leftovers, mluc_program, unique_instance};
use mluc_dataset::scan_bytes;
use mluc_model::{Grid, Manifest, Network, formula_weights, model_bytes};
use mluc_runtime::{Instance, Shell, Shutdown};
use rustix::process::Signal;
use serde_json::Value;
use std::{fs, path::Path, path::PathBuf, process::Command, time::Duration};
use tempfile::TempDir;

/// A calibration with KITTI's axes at the sensor, without a camera.
pub const NO_CAMERA: &str = "P2: 0 0 0 0 0 0 0 0 0 0 0 0\nR0_rect: 1 0 0 0 1 0 0 0 1\n\
    Tr_velo_to_cam: 0 -1 0 0 0 0 -1 0 1 0 0 0\n";

/// Writes a small and fast model with weights by formula: it reacts to shapes but has learned nothing. Its gate makes half of its
/// boxes candidates, so that all stages have work.
pub fn untrained_model(folder: &Path) -> PathBuf {
    let network = Network::compact(Grid::kitti_compact(), 3);
    let weights = formula_weights(&network);
    let mut manifest = Manifest::untrained("untrained", network);
    manifest.thresholds.objectness_min = 0.6;
    manifest.thresholds.boxes_max = 40;
    manifest.thresholds.eds_normalised_max = 1.5;
    let path = folder.join("untrained.safetensors");
    let bytes = model_bytes(&manifest, &weights).expect("a sound model");
    fs::write(&path, bytes).expect("a writable folder");
    path
}

/// A model file of setting udi with weights by formula, on a small map: it has learned nothing, but every stage has work.
pub fn untrained_udi() -> Vec<u8> {
    let grid = Grid::udi().within([-12.8, 12.8], [-12.8, 12.8]);
    let mut manifest = Manifest::untrained("udi", Network::compact(grid, 4));
    manifest.thresholds.candidates_max = 300;
    model_bytes(&manifest, &formula_weights(&manifest.network)).expect("a sound model")
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

/// What a pipeline test needs: a folder with the untrained model and sound scans, and a name for the instance.
pub struct Setting {
    /// Deleted when the setting is dropped.
    pub folder: TempDir,
    /// The model of [`untrained_model`].
    pub model: PathBuf,
    /// The folder of the scans 000000.bin and so on.
    pub input: PathBuf,
    /// The name of this setting's own instance.
    pub instance: String,
}

impl Setting {
    /// Starts a program in this instance; the test itself starts and ends it.
    pub fn start_by_hand(&self, command: &[String]) -> Running {
        let mut process = Command::new(&command[0]);
        process.env("MLUC_INSTANCE", &self.instance);
        Running::start(process.args(&command[1..]))
    }

    pub fn new(label: &str, scans: usize) -> Setting {
        let folder = tempfile::tempdir().expect("a writable folder");
        let input = folder.path().join("scans");
        fs::create_dir(&input).expect("a writable folder");
        let setting = Setting {
            model: untrained_model(folder.path()),
            input,
            instance: unique_instance(label),
            folder,
        };
        for number in 0..scans {
            setting.write_scan(&format!("{number:06}"), &car_scan(8.0 + number as f32));
        }
        setting
    }

    /// Writes KITTI's `.bin` next to the others; returns its path.
    pub fn write_scan(&self, name: &str, points: &[[f32; 4]]) -> PathBuf {
        let path = self.input.join(format!("{name}.bin"));
        fs::write(&path, scan_bytes(points)).expect("a writable folder");
        path
    }

    /// `mluc up` with options as on a command line, at pace `complete` unless they have another.
    pub fn up(&self, options: &str) -> Running {
        Running::start(&mut self.up_command(options))
    }

    /// The command of [`Setting::up`].
    pub fn up_command(&self, options: &str) -> Command {
        let mut words = format!("up --instance {} {options}", self.instance);
        if !options.contains("--pace") {
            words += " --pace complete";
        }
        self.command(&words)
    }

    /// Runs [`Setting::up`] to its end; nothing may be left in shared memory then.
    #[track_caller]
    pub fn run(&self, options: &str) -> Finished {
        self.finish(self.up(options))
    }

    /// Waits for the end of a pipeline of this setting; nothing may be left of it in shared memory.
    #[track_caller]
    pub fn finish(&self, run: Running) -> Finished {
        let run = run.finish();
        assert_eq!(leftovers(&self.instance), [""; 0], "{}", run.log);
        run
    }

    /// [`Running::stop`], then [`Setting::finish`].
    #[track_caller]
    pub fn stop(&self, run: Running) -> Finished {
        run.signal(Signal::TERM);
        let run = self.finish(run);
        assert_eq!(run.code, Some(0), "{}", run.log);
        run
    }

    /// Writes `mluc.toml` and returns the option that names it.
    pub fn config(&self, text: &str) -> String {
        let path = self.folder.path().join("mluc.toml");
        fs::write(&path, text).expect("a writable folder");
        format!("--config {}", path.display())
    }

    /// `mluc stage NAME` of an instance, at pace `complete`.
    pub fn stage(&self, name: &str, instance: &str) -> Running {
        let words = format!("stage {name} --instance {instance} --pace complete");
        Running::start(&mut self.command(&words))
    }

    /// Writes a scan that blocks every process that opens it: a pipe that nobody writes to.
    pub fn write_hanging_scan(&self, name: &str) {
        let path = self.input.join(format!("{name}.bin"));
        fs::remove_file(&path).expect("it was there");
        let made = Command::new("mkfifo").arg(&path).status();
        assert!(made.expect("mkfifo starts").success());
    }

    /// A shell that only observes.
    pub fn observer(&self) -> Shell {
        let instance = Instance::new(&self.instance).expect("a name");
        Shell::observer(&instance, None, Shutdown::default()).expect("it runs")
    }

    /// Starts `mluc record` of the setting's instance into a file of its folder; also returns the file's path.
    pub fn start_record(&self, name: &str, options: &str) -> (Running, String) {
        let path = self.folder.path().join(name).display().to_string();
        let instance = &self.instance;
        let words = format!("record --out {path} --instance {instance} {options}");
        let mut record = Running::mluc(words.split_whitespace());
        record.wait_for_words("Ctrl-C ends it");
        (record, path)
    }

    /// Runs `mluc replay` of a recording, with options as on a command line, to its end.
    pub fn replay(&self, path: &str, options: &str) -> Finished {
        let instance = unique_instance("replay");
        let words = format!("replay --input {path} --instance {instance} {options}");
        Running::mluc(words.split_whitespace()).finish()
    }

    /// Where [`Setting::bench`] writes its report.
    pub fn report(&self) -> PathBuf {
        self.folder.path().join("report")
    }

    /// Starts `mluc bench` on the setting's scans, with a report.
    pub fn start_bench(&self, options: &str) -> Running {
        let out = self.report();
        let words = format!("bench --out {} {options}", out.display());
        Running::start(&mut self.command(&words))
    }

    /// Runs [`Setting::start_bench`] to its end; it must succeed, at most with warnings.
    #[track_caller]
    pub fn bench(&self, options: &str) -> Finished {
        let run = self.start_bench(options);
        let run = run.finish_within(Duration::from_secs(180));
        run.assert_ended_well();
        run
    }

    /// `mluc COMMAND` on the setting's model and scans.
    fn command(&self, words: &str) -> Command {
        let mut command = Command::new(mluc_program());
        command.args(words.split_whitespace());
        command.arg("--model").arg(&self.model);
        command.arg("--input").arg(&self.input);
        command
    }
}

/// Writes a file, and creates the folders above it.
pub fn write_file(path: &Path, content: impl AsRef<[u8]>) {
    fs::create_dir_all(path.parent().expect("a parent")).expect("a folder");
    fs::write(path, content).expect("a writable folder");
}

pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

pub fn read_json(path: &Path) -> Value {
    let text = fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    serde_json::from_str(&text).expect("JSON")
}
