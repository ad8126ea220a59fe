//! The request of an adaptation, and the amount of work that fits the time, from a short probe of this machine.

use super::super::{simulate::export_with_progress, terminal::print_err};
use super::{super::train::commit, super::train::train, lower};
use anyhow::{Context, ensure};
use mluc_dataset::whole_file::write_whole;
use mluc_model::SensorProfile;
use mluc_simulate::{Class, ExportOptions, Family, Split};
use mluc_train::TrainSettings;
use serde::{Deserialize, Serialize};
use std::{path::Path, path::PathBuf, time::Instant};

const BATCH: usize = 4;
/// Number of times that a scan is trained on: a guess that balances few scenes against few repetitions.
const PASSES: f64 = 3.0;
/// Highest learning rate: a third of a fresh network's, since the initial weights are good. A guess.
const LEARNING_RATE: f64 = 0.001;
/// Number of full-circle scans, and number of steps, in the probe.
const PROBE: (f64, u64) = (8.0, 3);
/// Validation scans per hour of the request, and their minimum and maximum.
const VAL_SCANS: (f64, [f64; 2]) = (120.0, [30.0, 240.0]);
/// Evaluating a validation scan before, after and in each precision takes as long as training on this many scans (a guess), other work this share of the time.
const JUDGE_SCANS: f64 = 2.5;
const OTHER_SHARE: f64 = 0.08;
/// Minimum number of full-circle scans for training, and maximum number that the simulator writes.
const SCANS_MIN: f64 = 12.0;
const SCANS_MAX: f64 = 1e6;

/// The request; a folder belongs to one request.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Request {
    pub(super) sensor: SensorProfile,
    /// Classes, lower case.
    pub(super) known: Vec<String>,
    pub(super) hours: f64,
    /// Fingerprint of the initial weights.
    pub(super) init: String,
    /// Version of the program: another version simulates other scans.
    #[serde(default)]
    pub(super) version: String,
}

/// Measurements of the probe, and the plan that follows from them.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Plan {
    pub(super) request: Request,
    /// Time per scan on all threads, s: to simulate it and to train on it.
    pub(super) simulate_s: f64,
    pub(super) train_s: f64,
    /// Bytes on disk per scan.
    pub(super) scan_bytes: u64,
    pub(super) scans: u32,
    pub(super) val_scans: u32,
    pub(super) steps: u64,
    /// Whether training multiplies in bf16: decided once, since a run continues as it started.
    #[serde(default)]
    pub(super) bf16: bool,
}

impl Request {
    /// Options for simulating scans of this sensor with these classes.
    pub(super) fn export(&self, split: Split, scans: u32, folder: PathBuf) -> ExportOptions {
        let is_known = |class: &Class| self.known.contains(&lower(*class));
        ExportOptions {
            sensor: Some(self.sensor.clone()),
            synthetic_unknown: split == Split::Train,
            known: Class::REAL.into_iter().filter(is_known).collect(),
            resume: true,
            ..ExportOptions::new(Family::SimAny, split, scans, 1, folder)
        }
    }

    /// Number of scans that show as much as `all` full-circle scans, so that every class is seen; at most 64 (a guess).
    fn scans(&self, all: f64) -> f64 {
        let width_deg = self.sensor.field_deg.map_or(360.0, |[_, width]| width);
        (all * 360.0 / f64::from(width_deg)).ceil().min(64.0)
    }

    /// Settings of the training from the initial weights, which are in `out`.
    pub(super) fn settings(&self, data: &Path, run: &Path, out: &Path) -> TrainSettings {
        let options = ["--setting", "any", "--network", "mluc-full"];
        TrainSettings {
            known: self.known.clone(),
            init: Some(out.join("init.safetensors")),
            batch: BATCH,
            learning_rate: LEARNING_RATE,
            commit: commit(),
            // Half a minute to two minutes of work.
            checkpoint_every: 10,
            // Its model is evaluated here, once.
            validate_frames: 0,
            ..TrainSettings::of(&options, data, run)
        }
    }
}

impl Plan {
    /// The plan in the folder, or a new one; a plan for another request is an error. Prints the total cost.
    pub(super) fn of(request: Request, init: &[u8], out: &Path) -> anyhow::Result<Plan> {
        let path = out.join("plan.json");
        let first = out.join("init.safetensors");
        let plan = if path.exists() {
            let text = std::fs::read_to_string(&path).context("plan.json")?;
            let plan: Plan = serde_json::from_str(&text).context("plan.json")?;
            ensure!(
                plan.request == request,
                "{}: expected the same --sensor, --known, --hours and --init, and mluc-lab {}, found others; name another folder",
                path.display(),
                request.version
            );
            print_err("begun before: resuming after the last finished step");
            plan
        } else {
            write_whole(&first, init).with_context(|| first.display().to_string())?;
            let plan = Plan::probed(request, out)?;
            let text = serde_json::to_string_pretty(&plan)?;
            write_whole(&path, text.as_bytes()).context("plan.json")?;
            plan
        };
        plan.say(out);
        Ok(plan)
    }

    /// Simulates a few scans and trains on them for a few steps.
    fn probed(request: Request, out: &Path) -> anyhow::Result<Plan> {
        print_err("a short probe of this machine");
        let start = Instant::now();
        let folder = out.join(".probe");
        if folder.exists() {
            std::fs::remove_dir_all(&folder).context("the probe's folder")?;
        }
        let (scans, steps) = (request.scans(PROBE.0) as u32, PROBE.1);
        let train_folder = folder.join("scans/train");
        export_with_progress(&request.export(Split::Train, scans, train_folder.clone()))?;
        let simulate_s = start.elapsed().as_secs_f64() / f64::from(scans);
        let files = std::fs::read_dir(train_folder.join("velodyne"))?;
        let bytes: u64 = files.flatten().filter_map(|f| Some(f.metadata().ok()?.len())).sum();
        // In addition the instance of every point, 2 bytes for 16.
        let scan_bytes = bytes / u64::from(scans) * 9 / 8;
        let mut settings = request.settings(&folder.join("scans"), &folder.join("run"), out);
        (settings.steps, settings.bf16) = (steps, TrainSettings::bf16_is_faster());
        train(&settings)?;
        // Time of the steps only: work that a run does once is included in the other work.
        let log = std::fs::read_to_string(settings.out.join("train.jsonl"))?;
        let line: serde_json::Value = serde_json::from_str(log.trim()).context("train.jsonl")?;
        let frames_per_s = line["frames_per_s"].as_f64().context("frames_per_s")?;
        let train_s = frames_per_s.recip();
        std::fs::remove_dir_all(&folder).context("the probe's folder")?;
        let times_s = [simulate_s, train_s, start.elapsed().as_secs_f64()];
        Ok(Plan::fitted(request, times_s, scan_bytes))
    }

    /// Plans as many scans as the time allows. Times in s: to simulate a scan, to train on a scan, and of the probe.
    fn fitted(request: Request, [simulate_s, train_s, probe_s]: [f64; 3], scan_bytes: u64) -> Plan {
        let (an_hour, [fewest, most]) = VAL_SCANS;
        let val_scans = (request.hours * an_hour).clamp(fewest, most);
        let val_s = val_scans * (simulate_s + JUDGE_SCANS * train_s);
        let left_s = request.hours * 3600.0 * (1.0 - OTHER_SHARE) - probe_s - val_s;
        let scans = left_s / (simulate_s + PASSES * train_s);
        let scans = scans.clamp(request.scans(SCANS_MIN), SCANS_MAX);
        Plan {
            simulate_s,
            train_s,
            scan_bytes,
            scans: scans as u32,
            val_scans: val_scans as u32,
            steps: (scans * PASSES / BATCH as f64).max(1.0) as u64,
            bf16: TrainSettings::bf16_is_faster(),
            request,
        }
    }

    /// Minutes of simulation, training and evaluation.
    fn minutes(&self) -> [f64; 3] {
        let (scans, val) = (f64::from(self.scans), f64::from(self.val_scans));
        let trained = self.steps as f64 * BATCH as f64;
        [
            (scans + val) * self.simulate_s,
            trained * self.train_s,
            val * JUDGE_SCANS * self.train_s + OTHER_SHARE * self.request.hours * 3600.0,
        ]
        .map(|seconds| seconds / 60.0)
    }

    fn say(&self, out: &Path) {
        let [simulate, train, judge] = self.minutes();
        let scans = u64::from(self.scans + self.val_scans);
        print_err(format_args!(
            "{}, known: {}\n\
             simulate {} scans and {} to judge by: {simulate:.0} min\n\
             train {} steps of {BATCH} scans: {train:.0} min\n\
             judge before and after, int8 ranges, scores: {judge:.0} min\n\
             in all about {:.2} of {} hours, {:.1} GB in {}",
            self.request.sensor.name,
            self.request.known.join(", "),
            self.scans,
            self.val_scans,
            self.steps,
            (simulate + train + judge) / 60.0,
            self.request.hours,
            (scans * self.scan_bytes) as f64 / 1e9,
            out.display()
        ));
        if f64::from(self.scans) <= 10.0 * self.request.scans(SCANS_MIN) {
            print_err("warning: so few scans teach little; give it more hours");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_plan_fits_the_hours() {
        for (hours, simulate_s, train_s) in [(1.0, 0.5, 0.3), (1.0, 0.2, 1.0), (8.0, 1.0, 0.2)] {
            let request = Request {
                sensor: SensorProfile::load("vlp-16").expect("a product"),
                known: vec!["car".into()],
                hours,
                init: String::new(),
                version: String::new(),
            };
            let mut plan = Plan::fitted(request, [simulate_s, train_s, 30.0], 1_000_000);
            let all: f64 = plan.minutes().iter().sum();
            assert!(all <= 60.0 * hours && all > 57.0 * hours, "{all} min: {plan:?}");
            plan.request.sensor.field_deg = Some([0.0, 120.0]);
            assert_eq!(plan.request.scans(SCANS_MIN), 36.0);
            plan.request.hours = 1000.0;
            let most = Plan::fitted(plan.request, [0.1, 0.1, 30.0], 1_000_000);
            assert_eq!(most.scans, 1_000_000);
        }
    }
}
