//! Options of training: classes and range, size of the network, and the task of its heads.

use clap::ValueEnum;
use mluc_model::{Grid, HeadKind, Network, VoxelInput};
use serde::{Deserialize, Serialize};

/// Classes, range and anchors (paper section 4.1).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Setting {
    /// All around, scans of an HDL-64E 1.73 m high (of other sensors: any): car, pedestrian, cyclist, truck.
    Udi,
    /// To the front, scans of such a sensor: car, pedestrian, cyclist.
    Kitti,
    /// All around, for any sensor: car, pedestrian, cyclist, measured from the ground.
    Any,
}

/// Size of the network.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Architecture {
    /// A tenth of the paper's network, for a few cores.
    Compact,
    /// The paper's network.
    Second,
}

/// What is trained: a row, or several, of the paper's tables.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum NetworkKind {
    /// The paper's metric head.
    #[default]
    Metric,
    /// The paper's metric head, which learns from synthetic unknown objects and from background too.
    MetricOpen,
    /// SECOND's own classifier: the closed set.
    Sigmoid,
    /// Objectness and a linear softmax: the naive baseline.
    Softmax,
    /// Ours: metric head, class-agnostic anchors, synthetic unknown objects.
    MlucFull,
    /// SECOND's classifier with the unknown classes labelled: the upper bound; needs scans with unknown objects.
    Supervised,
    /// A point embedding on the frozen trunk of a softmax network, which --init names: the OSIS baseline.
    Osis,
}

impl NetworkKind {
    /// The name on the command line, such as `metric`.
    pub fn name(self) -> String {
        self.to_possible_value().expect("no kind is skipped").get_name().to_owned()
    }

    /// Whether it learns the unknown from synthetic unknown objects.
    pub fn learns_from_synthetic_unknown(self) -> bool {
        matches!(self, NetworkKind::MetricOpen | NetworkKind::MlucFull)
    }

    /// The head kind in its model file.
    pub fn head(self) -> HeadKind {
        match self {
            NetworkKind::Metric | NetworkKind::MetricOpen => HeadKind::Metric,
            NetworkKind::Softmax | NetworkKind::Osis => HeadKind::Softmax,
            NetworkKind::MlucFull => HeadKind::Open,
            NetworkKind::Sigmoid | NetworkKind::Supervised => HeadKind::Sigmoid,
        }
    }
}

mluc_ipc_types::words!(Setting: "udi" "kitti" "any");

impl Setting {
    /// Number of known classes.
    pub fn classes(self) -> usize {
        match self {
            Setting::Udi => 4,
            Setting::Kitti | Setting::Any => 3,
        }
    }

    /// Wanted number of objects of a class in a frame after pasting: a choice.
    pub(crate) fn objects_wanted(self, class: &str) -> usize {
        match (self, class) {
            // These scans already have many objects, and an object from one sensor's scan does not fit another sensor.
            (Setting::Any, _) => 0,
            (Setting::Udi, "car") => 8,
            (Setting::Kitti, "car") => 15,
            (_, "pedestrian" | "cyclist") => 10,
            _ => 5,
        }
    }

    /// The network up to its heads.
    pub(crate) fn trunk(self, architecture: Architecture, classes: usize) -> Network {
        let grid = match (self, architecture) {
            (Setting::Any, _) => Grid::any(),
            (Setting::Udi, _) => Grid::udi(),
            (Setting::Kitti, Architecture::Compact) => Grid::kitti_compact(),
            (Setting::Kitti, Architecture::Second) => Grid::kitti_second(),
        };
        let mut network = match architecture {
            Architecture::Compact => Network::compact(grid, classes),
            Architecture::Second => Network::second(grid, classes),
        };
        if architecture == Architecture::Compact && self != Setting::Kitti {
            network = network.with_reach_of_trucks();
        }
        if self == Setting::Any {
            network.input = VoxelInput::Local;
            network.halo_layers = Some(network.block1.len() + 1);
            let halves = network.sparse.iter_mut().find(|layer| !layer.submanifold);
            halves.into_iter().for_each(|layer| layer.floor = true);
        }
        network
    }
}
