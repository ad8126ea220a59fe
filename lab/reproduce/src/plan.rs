//! The steps of a reproduction, in order.

use crate::train::{NETWORKS, NetworkPlan, Training};
use crate::{Layout, Options, Setting, layout::Run, simulate::Simulation};
use mluc_dataset::{PrepareOptions, Splits};
use mluc_evaluate::pipeline::unknown_classes;
use mluc_train::NetworkKind;

pub(crate) enum Work {
    Simulate(Box<Simulation>),
    /// Converts a split of recorded scans for the trainer: its purpose, and the options.
    Prepare(&'static str, PrepareOptions),
    Train(Training),
    /// Evaluates every row that runs on a network of this kind and seed.
    Evaluate(Run),
}

pub(crate) struct Step {
    pub(crate) setting: Setting,
    pub(crate) work: Work,
}

impl Step {
    pub(crate) fn name(&self) -> String {
        let with_seed = |network: NetworkKind, seed: u64| match seed {
            1 => network.name(),
            _ => format!("{}, seed {seed}", network.name()),
        };
        let work = match &self.work {
            Work::Simulate(s) => format!("simulate {} ({} frames)", s.name, s.options.frames),
            Work::Prepare(name, _) => format!("prepare {name}"),
            Work::Train(t) => {
                format!("train {} ({} steps)", with_seed(t.network, t.seed), t.steps)
            }
            Work::Evaluate((_, network, seed)) => {
                format!("evaluate {}", with_seed(*network, *seed))
            }
        };
        format!("{}: {work}", self.setting.name())
    }
}

/// Every step of the settings, including finished ones.
pub(crate) fn plan(options: &Options) -> Vec<Step> {
    let layout = &options.layout();
    let mut steps = Vec::new();
    for setting in options.settings() {
        let sizes = options.sizes(setting);
        let mut add = |work: Work| steps.push(Step { setting, work });
        for simulation in Simulation::all(layout, setting, &sizes) {
            add(Work::Simulate(Box::new(simulation)));
        }
        if let (Setting::Kitti, Some(splits)) = (setting, &options.kitti()) {
            for (name, preparation) in preparations(splits, layout) {
                add(Work::Prepare(name, preparation));
            }
        }
        let networks = networks(options.seeds);
        for &(network, seed) in &networks {
            let training = Training::new(layout, setting, &sizes, network, seed);
            add(Work::Train(training));
        }
        for &(NetworkPlan { network, .. }, seed) in &networks {
            add(Work::Evaluate((setting, *network, seed)));
        }
    }
    steps
}

/// KITTI's splits in the trainer's form, by purpose; training frames have no unknown object, the supervised network gets all frames.
pub(crate) fn preparations(splits: &Splits, place: &Layout) -> [(&'static str, PrepareOptions); 3] {
    let of = |name, split: &str, drop_unknown, what, folder| {
        let options = PrepareOptions {
            splits: splits.clone(),
            split: split.to_owned(),
            drop_unknown,
            unknown: unknown_classes(Setting::Kitti.trainer_name()),
            out: place.data_of(Setting::Kitti, what).join(folder),
        };
        (name, options)
    };
    [
        of("train", "train", true, "", "train"),
        of("supervised", "train", false, "-supervised", "train"),
        of("test", "val", false, "", "test"),
    ]
}

/// Kinds and seeds, each after the network that it starts from.
fn networks(seeds: u64) -> Vec<(&'static NetworkPlan, u64)> {
    let of_seed = |seed| {
        NETWORKS.iter().filter(move |n| seed == 1 || n.seeded).map(move |network| (network, seed))
    };
    (1..=seeds).flat_map(of_seed).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    /// The commands of a full plan of three seeds.
    fn commands() -> Vec<String> {
        let steps = plan(&Options::parse_from(["reproduce", "--seeds", "3"]));
        let command = |step: Step| match step.work {
            Work::Simulate(simulation) => Some(simulation.command()),
            Work::Train(training) => Some(training.command()),
            _ => None,
        };
        steps.into_iter().filter_map(command).collect()
    }

    #[test]
    fn every_network_begins_with_one_that_was_trained_before() {
        let mut there = Vec::new();
        for command in commands() {
            let after = |name: &str| command.split(' ').skip_while(|word| *word != name).nth(1);
            if let Some(model) = after("--init") {
                assert!(there.iter().any(|run| model.starts_with(run)), "{command}");
            }
            let run = after("--out").filter(|_| command.starts_with("mluc-lab train"));
            there.extend(run.map(|run| format!("{run}/model")));
        }
        // Every kind, and two more seeds of three of the kinds, in two settings.
        assert_eq!(there.len(), 2 * (NETWORKS.len() + 2 * 3));
    }

    #[test]
    fn two_networks_learn_from_scans_with_synthetic_unknown_objects() {
        let mut commands = commands();
        commands.retain(|c| !c.contains("--seed 2 ") && !c.contains("--seed 3 "));
        for setting in ["sim-udi", "sim-kitti"] {
            let data = format!(" data/{setting}-synthetic-unknown");
            let users = commands.iter().filter(|command| command.contains(&data));
            let users: Vec<&str> = users.map(String::as_str).collect();
            let [made, open, full] = users[..] else {
                panic!("{users:?}");
            };
            assert!(made.contains("--synthetic-unknown "));
            assert!(open.contains(" metric-open ") && full.contains(" mluc-full "));
        }
    }
}
