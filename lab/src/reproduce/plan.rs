//! The steps of a reproduction, in order.

use super::Setting;
use super::kitti::Preparation;
use super::rows::rows_on;
use super::run::Options;
use super::simulate::Simulation;
use super::train::{NETWORKS, OSIS_IS_TRAINED, SEEDED, Training};

/// What a step does.
#[derive(Clone, Debug, PartialEq)]
pub enum Work {
    /// Simulates a split.
    Simulate(Simulation),
    /// Brings a split of recorded scans into the trainer's form.
    Prepare(Preparation),
    /// Trains a network.
    Train(Training),
    /// Judges every row that stands on a network.
    Evaluate {
        /// Kind of network.
        network: &'static str,
        /// Seed.
        seed: u64,
    },
}

/// A step.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    /// Of which setting.
    pub setting: Setting,
    /// What it does.
    pub work: Work,
    /// Seconds that it takes on two quiet cores: a guess, for the time left alone.
    pub estimate_s: f64,
}

impl Step {
    /// For a person.
    pub fn name(&self) -> String {
        let setting = self.setting.name();
        let with_seed = |network: &str, seed: u64| match seed {
            1 => network.to_owned(),
            _ => format!("{network}, seed {seed}"),
        };
        match &self.work {
            Work::Simulate(s) => format!("{setting}: simulate {} ({} frames)", s.name, s.frames),
            Work::Prepare(p) => format!("{setting}: prepare {}", p.name),
            Work::Train(t) => {
                let network = with_seed(t.network, t.seed);
                format!("{setting}: train {network} ({} steps)", t.steps)
            }
            Work::Evaluate { network, seed } => {
                format!("{setting}: evaluate {}", with_seed(network, *seed))
            }
        }
    }
}

/// The steps.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// In order.
    pub steps: Vec<Step>,
}

/// Seconds on two cores, measured beside other work: a simulated frame, a step of two frames, a frame through the
/// network, a frame through all thresholds of a row.
struct Pace {
    frame_s: f64,
    step_s: f64,
    network_s: f64,
    row_s: f64,
}

fn pace(setting: Setting) -> Pace {
    match setting {
        Setting::SimUdi => Pace {
            frame_s: 0.1,
            step_s: 0.75,
            network_s: 0.16,
            row_s: 0.12,
        },
        Setting::SimKitti | Setting::Kitti => Pace {
            frame_s: 0.04,
            step_s: 0.38,
            network_s: 0.08,
            row_s: 0.06,
        },
    }
}

impl Plan {
    /// Every step for the settings, whether its outcome is there or not.
    pub fn new(options: &Options) -> Plan {
        let layout = &options.layout;
        let mut steps = Vec::new();
        for &setting in &options.settings {
            let (sizes, pace) = (options.sizes(setting), pace(setting));
            let mut add = |work: Work, estimate_s: f64| {
                steps.push(Step {
                    setting,
                    work,
                    estimate_s,
                });
            };
            for simulation in Simulation::all(layout, setting, &sizes) {
                let seconds = f64::from(simulation.frames) * pace.frame_s;
                add(Work::Simulate(simulation), seconds);
            }
            if let (Setting::Kitti, Some(source)) = (setting, &options.kitti) {
                for preparation in source.preparations(layout) {
                    add(Work::Prepare(preparation), 120.0);
                }
            }
            let networks = networks(options.seeds);
            let trained = networks
                .iter()
                .filter(|(network, _)| *network != "osis" || OSIS_IS_TRAINED);
            for &(network, seed) in trained {
                let training = Training::new(layout, setting, &sizes, network, seed);
                let seconds = training.steps as f64 * pace.step_s * f64::from(sizes.batch) / 2.0;
                add(Work::Train(training), seconds);
            }
            for &(network, seed) in &networks {
                let rows = rows_on(network, seed).count();
                let frame_s = pace.network_s + rows as f64 * pace.row_s;
                let seconds = f64::from(sizes.test_frames) * frame_s;
                add(Work::Evaluate { network, seed }, seconds);
            }
        }
        Plan { steps }
    }
}

/// Kinds and seeds, each after what it begins with.
fn networks(seeds: u64) -> Vec<(&'static str, u64)> {
    let first = NETWORKS.iter().map(|network| (*network, 1));
    let more = (2..=seeds).flat_map(|seed| SEEDED.iter().map(move |network| (*network, seed)));
    first.chain(more).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reproduce::rows::METHOD_NETWORKS;
    use crate::reproduce::{Layout, Size};
    use std::path::PathBuf;

    fn plan(seeds: u64) -> Plan {
        Plan::new(&Options {
            layout: Layout {
                data: PathBuf::from("data"),
                runs: PathBuf::from("runs"),
                out: PathBuf::from("out"),
            },
            settings: vec![Setting::SimUdi, Setting::SimKitti],
            size: Size::Full,
            test_frames: None,
            seeds,
            train: true,
            program: PathBuf::new(),
            commit: String::new(),
            command: String::new(),
            real: Vec::new(),
            kitti: None,
        })
    }

    #[test]
    fn every_network_begins_with_one_that_was_trained_before() {
        let mut there: Vec<PathBuf> = Vec::new();
        for step in plan(3).steps {
            let Work::Train(training) = step.work else {
                continue;
            };
            let after = |name: &str| {
                let at = training.arguments.iter().position(|a| a == name)?;
                training.arguments.get(at + 1).map(PathBuf::from)
            };
            if let Some(model) = after("--init") {
                assert!(there.contains(&model), "{}", training.command());
            }
            there.push(after("--out").expect("a folder").join("model.safetensors"));
        }
        // Every kind, and two more seeds of three of them, in two settings.
        let kinds = NETWORKS.len() - usize::from(!OSIS_IS_TRAINED);
        assert_eq!(there.len(), 2 * (kinds + 2 * 3));
    }

    #[test]
    fn two_networks_learn_from_scans_with_made_up_objects() {
        let steps = plan(1).steps;
        let made: Vec<&Simulation> = steps
            .iter()
            .filter_map(|step| match &step.work {
                Work::Simulate(s) if s.command().contains(" --made-up ") => Some(s),
                _ => None,
            })
            .collect();
        assert_eq!(made.len(), 2);
        let learning: Vec<String> = steps
            .iter()
            .filter_map(|step| match &step.work {
                Work::Train(t) if ["metric-open", "improved"].contains(&t.network) => {
                    Some(t.command())
                }
                _ => None,
            })
            .collect();
        for (simulation, command) in made.iter().flat_map(|s| [s, s]).zip(&learning) {
            let data = simulation.folder.parent().expect("a data set").display();
            assert!(command.contains(&format!("--data {data} ")), "{command}");
        }
        assert_eq!(learning.len(), 4);
    }

    #[test]
    fn every_row_is_evaluated_once() {
        let plan = plan(1);
        let evaluated: Vec<&str> = plan
            .steps
            .iter()
            .filter(|step| step.setting == Setting::SimKitti)
            .filter_map(|step| match &step.work {
                Work::Evaluate { network, .. } => Some(*network),
                _ => None,
            })
            .collect();
        for (method, network) in METHOD_NETWORKS {
            assert_eq!(
                evaluated.iter().filter(|n| **n == network).count(),
                1,
                "{method}"
            );
        }
    }
}
