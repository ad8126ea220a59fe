//! Taking the steps, one after the other.

use super::assemble::write_report;
use super::evaluate::evaluate_network;
use super::kitti::KittiSource;
use super::layout::Layout;
use super::plan::{Plan, Step, Work};
use super::simulate::Simulation;
use super::train::{RunState, run_state};
use super::{ReproduceError, Setting, Size, Sizes};
use crate::dataset::Dataset;
use crate::dataset::data_hash;
use crate::pipeline::FrameSet;
use crate::report::Report;
use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::path::PathBuf;
use std::time::Instant;

/// What a reproduction can be told.
#[derive(Clone, Debug)]
pub struct Options {
    /// Folders.
    pub layout: Layout,
    /// What to make tables of.
    pub settings: Vec<Setting>,
    /// Size of the plan.
    pub size: Size,
    /// Test scans, where not the plan's number.
    pub test_frames: Option<u32>,
    /// Networks of the kinds that are trained more than once.
    pub seeds: u64,
    /// Train what is missing or unfinished; otherwise rows without a network are left out.
    pub train: bool,
    /// This program, which trains in a process of its own.
    pub program: PathBuf,
    /// Commit of the program.
    pub commit: String,
    /// The command, for the report.
    pub command: String,
    /// Folders of recorded scans on which the rows of `sim-kitti` are shown too.
    pub real: Vec<PathBuf>,
    /// KITTI's benchmark, for [`Setting::Kitti`].
    pub kitti: Option<KittiSource>,
}

impl Options {
    /// Frames and steps of a setting.
    pub fn sizes(&self, setting: Setting) -> Sizes {
        let sizes = self.size.sizes(setting);
        Sizes {
            test_frames: self.test_frames.unwrap_or(sizes.test_frames),
            ..sizes
        }
    }
}

/// Where a reproduction shows how far it is. Called from many threads.
pub trait Screen: Sync {
    /// A step begins: its number from 1, how many there are, what it is, seconds left for all (a guess).
    fn step(&self, number: usize, steps: usize, name: &str, left_s: f64);
    /// Something of so many parts begins.
    fn count(&self, what: &str, total: u64);
    /// A part is done.
    fn tick(&self);
    /// Something worth a line.
    fn note(&self, text: &str);
    /// Another program is about to write to the terminal.
    fn clear(&self);
}

/// The frames that figures are taken on.
pub(super) struct Test {
    pub setting: Setting,
    pub set: FrameSet,
    pub hash: String,
}

impl Test {
    fn open(options: &Options, setting: Setting) -> Result<Test, ReproduceError> {
        let folder = options.layout.data_of(setting).join("test");
        let frames = match setting {
            // All of a recorded split.
            Setting::Kitti => usize::MAX,
            _ => options.sizes(setting).test_frames as usize,
        };
        let set = FrameSet::open(&folder, None, frames)?;
        let hash = data_hash(&Dataset::open(&folder)?, set.len())?;
        Ok(Test { setting, set, hash })
    }
}

/// Takes every step whose outcome is not there yet, then writes the report. What is done stays where a step fails.
pub fn run(options: &Options, screen: &dyn Screen) -> Result<Report, ReproduceError> {
    // What would stop the report is looked at first: hours lie between.
    for folder in &options.real {
        FrameSet::open(folder, None, 1)?;
    }
    let out = &options.layout.out;
    std::fs::create_dir_all(out).map_err(ReproduceError::io(out))?;
    let plan = Plan::new(options);
    let mut tests: BTreeMap<Setting, Test> = BTreeMap::new();
    let (mut spent_s, mut guessed_s) = (0.0, 0.0);
    for (index, step) in plan.steps.iter().enumerate() {
        if is_done(options, step)? {
            if let Work::Evaluate { .. } = step.work {
                screen.note(&format!("{}: no model, its rows are left out", step.name()));
            }
            continue;
        }
        let ahead: f64 = plan.steps[index..]
            .iter()
            .map(|step| todo_s(options, step))
            .sum();
        let pace = if guessed_s > 0.0 {
            spent_s / guessed_s
        } else {
            1.0
        };
        screen.step(index + 1, plan.steps.len(), &step.name(), ahead * pace);
        let begun = Instant::now();
        take(options, step, &mut tests, screen)?;
        spent_s += begun.elapsed().as_secs_f64();
        guessed_s += step.estimate_s;
    }
    for &setting in &options.settings {
        test_of(&mut tests, options, setting)?;
    }
    write_report(options, &tests, screen)
}

/// The test frames of a setting, opened once.
fn test_of<'a>(
    tests: &'a mut BTreeMap<Setting, Test>,
    options: &Options,
    setting: Setting,
) -> Result<&'a Test, ReproduceError> {
    Ok(match tests.entry(setting) {
        Entry::Occupied(test) => test.into_mut(),
        Entry::Vacant(place) => place.insert(Test::open(options, setting)?),
    })
}

/// Whether nothing is left to do. Evaluations that are up to date say so themselves, once they have looked at the model.
fn is_done(options: &Options, step: &Step) -> Result<bool, ReproduceError> {
    match &step.work {
        Work::Simulate(simulation) => is_simulated(options, simulation),
        Work::Prepare(preparation) => Ok(preparation.is_done()),
        Work::Train(training) => {
            Ok(!options.train || run_state(&training.folder)? == RunState::Done)
        }
        // Nothing can be judged where nothing was and will be trained.
        Work::Evaluate { network, seed } => {
            let folder = options.layout.run_of(step.setting, network, *seed);
            Ok(!options.train && run_state(&folder)? == RunState::Missing)
        }
    }
}

/// Where nothing is trained only the test frames are needed.
fn is_simulated(options: &Options, simulation: &Simulation) -> Result<bool, ReproduceError> {
    if !options.train && simulation.name != "test" {
        return Ok(true);
    }
    simulation.is_done()
}

/// Seconds that a step will take; 0 when it is done.
fn todo_s(options: &Options, step: &Step) -> f64 {
    match is_done(options, step) {
        Ok(true) => 0.0,
        _ => step.estimate_s,
    }
}

fn take(
    options: &Options,
    step: &Step,
    tests: &mut BTreeMap<Setting, Test>,
    screen: &dyn Screen,
) -> Result<(), ReproduceError> {
    match &step.work {
        Work::Simulate(simulation) => {
            screen.count("frames", u64::from(simulation.frames));
            simulation.run(|| screen.tick())
        }
        Work::Prepare(preparation) => {
            screen.count("frames", 0);
            preparation.run(|| screen.tick())
        }
        Work::Train(training) => {
            screen.clear();
            training.run(&options.program)
        }
        Work::Evaluate { network, seed } => {
            let folder = options.layout.run_of(step.setting, network, *seed);
            let folder_name = folder.display();
            match run_state(&folder)? {
                RunState::Missing => return Ok(()),
                RunState::Unfinished { step, steps } => screen.note(&format!(
                    "{folder_name}: not trained to its end (step {step} of {steps}), judged as it stands"
                )),
                RunState::Done => {}
            }
            let test = test_of(tests, options, step.setting)?;
            let resamples = options.sizes(step.setting).resamples;
            evaluate_network(&options.layout, test, (network, *seed), resamples, screen)
        }
    }
}
