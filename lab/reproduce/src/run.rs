//! Runs the steps, one after the other.

use crate::options::{Options, Screen, TestFrames, Tests};
use crate::{Result, Setting, assemble::write_report, evaluate::evaluate_network};
use crate::{plan::Step, plan::Work, plan::plan, train::RunState, train::run_state};
use mluc_dataset::{Dataset, check_files, prepare};
use mluc_evaluate::EvaluateError;
use std::{collections::btree_map::Entry, path::PathBuf};

/// Runs every step without a result, then writes the report and returns its path. If a step fails, the finished results stay.
pub fn run(options: &Options, screen: &dyn Screen) -> Result<PathBuf> {
    // Problems that would stop the report are checked first: the steps take hours.
    if !options.real.is_empty() && !options.settings().contains(&Setting::SimKitti) {
        let what = "--real: expected --setting kitti or both settings, found others";
        return Err(EvaluateError::Input(what.to_owned()));
    }
    for folder in &options.real {
        check_files(&Dataset::open(folder)?)?;
    }
    let _alone = mluc_train::enter(&options.layout().runs)?;
    let plan = plan(options);
    let mut has_network = false;
    for step in &plan {
        match (&step.work, is_done(options, step)?) {
            (Work::Prepare(_, of), false) => check_files(&of.splits.open(&of.split)?)?,
            (Work::Evaluate(_), is_impossible) => has_network |= !is_impossible,
            _ => (),
        }
    }
    if !has_network {
        let what = "expected a trained network of at least one kind (NETWORK/model.safetensors), found none";
        return Err(EvaluateError::file(&options.layout().runs, what));
    }
    let out = &options.layout().out;
    std::fs::create_dir_all(out).map_err(|e| EvaluateError::file(out, e))?;
    let mut tests = Tests::new();
    for (index, step) in plan.iter().enumerate() {
        if is_done(options, step)? {
            if let Work::Evaluate(..) = step.work {
                screen.note(&format!("{}: no model, its rows are left out", step.name()));
            }
            continue;
        }
        screen.step(index + 1, plan.len(), &step.name());
        take(options, step, &mut tests, screen)?;
    }
    for setting in options.settings() {
        test_frames(&mut tests, options, setting)?;
    }
    write_report(options, &tests, screen)
}

/// The test frames of a setting, opened once.
fn test_frames<'a>(tests: &'a mut Tests, options: &Options, of: Setting) -> Result<&'a TestFrames> {
    Ok(match tests.entry(of) {
        Entry::Occupied(test) => test.into_mut(),
        Entry::Vacant(place) => place.insert(TestFrames::open(options, of)?),
    })
}

/// Whether a step has nothing left to do. An evaluation step always runs: it returns early where its results are current for the model.
fn is_done(options: &Options, step: &Step) -> Result<bool> {
    match &step.work {
        // Without training only the test frames are needed.
        Work::Simulate(simulation) => {
            let is_needed = options.train || simulation.name == "test";
            Ok(!is_needed || simulation.is_done()?)
        }
        Work::Prepare(name, of) => {
            let is_needed = options.train || *name == "test";
            Ok(!is_needed || of.out.is_dir())
        }
        Work::Train(task) => Ok(!options.train || run_state(&task.folder)? == RunState::Done),
        // An evaluation is impossible where no network exists and none will be trained.
        Work::Evaluate(run) => {
            let folder = options.layout().run_of(*run);
            Ok(!options.train && run_state(&folder)? == RunState::Missing)
        }
    }
}

fn take(options: &Options, step: &Step, tests: &mut Tests, screen: &dyn Screen) -> Result<()> {
    match &step.work {
        Work::Simulate(simulation) => {
            screen.count("frames", u64::from(simulation.options.frames));
            simulation.run(|| screen.tick())
        }
        Work::Prepare(_, options) => {
            let frames = options.splits.open(&options.split)?.names().len();
            screen.count("frames", frames as u64);
            Ok(prepare(options, || screen.tick())?)
        }
        Work::Train(training) => {
            screen.clear();
            training.run(&options.program)
        }
        Work::Evaluate(run) => {
            let folder = options.layout().run_of(*run);
            match run_state(&folder)? {
                RunState::Missing => return Ok(()),
                RunState::Unfinished { step, steps } => screen.note(&format!(
                    "{}: not trained to its end (step {step} of {steps}), judged as it is",
                    folder.display()
                )),
                RunState::Done => {}
            }
            let test = test_frames(tests, options, step.setting)?;
            evaluate_network(&options.layout(), test, *run, screen)
        }
    }
}
