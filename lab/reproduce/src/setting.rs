//! What tables are made on, and how large a reproduction is: one table that the documentation quotes.

/// What the tables are made on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Setting {
    /// Simulated industrial park, all around: knowns car, pedestrian, cyclist, truck; unknown golf cart, forklift.
    SimUdi,
    /// Simulated streets, ahead: knowns car, pedestrian, cyclist; unknown van, truck.
    SimKitti,
    /// KITTI's object benchmark, where a user has it; classes as `SimKitti`.
    Kitti,
}

impl Setting {
    /// Key in `report.json`, name of its folders.
    pub fn name(self) -> &'static str {
        match self {
            Setting::SimUdi => "sim-udi",
            Setting::SimKitti => "sim-kitti",
            Setting::Kitti => "kitti",
        }
    }

    /// The trainer's name of its classes and range.
    pub fn trainer_name(self) -> &'static str {
        match self {
            Setting::SimUdi => "udi",
            Setting::SimKitti | Setting::Kitti => "kitti",
        }
    }

    /// The simulator's family; none for recorded scans.
    pub fn family(self) -> Option<mluc_simulate::Family> {
        match self {
            Setting::SimUdi => Some(mluc_simulate::Family::SimUdi),
            Setting::SimKitti => Some(mluc_simulate::Family::SimKitti),
            Setting::Kitti => None,
        }
    }
}

/// Size of the plan.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Size {
    /// Figures that mean something: hours on two cores.
    Full,
    /// The whole way in twelve minutes on two cores; the figures mean little.
    Quick,
    /// The whole way in a minute, for tests; the figures mean nothing.
    Smoke,
}

/// Frames and steps of a plan, for one setting.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sizes {
    /// Training scans, known classes alone.
    pub train_frames: u32,
    /// Training scans of the supervised network: unknown classes too, labelled.
    pub supervised_frames: u32,
    /// Validation scans: the trainer's own look at a network.
    pub val_frames: u32,
    /// Test scans: every figure of the report.
    pub test_frames: u32,
    /// Steps of the base network (`metric`).
    pub base_steps: u64,
    /// Steps of each network that begins with the base's weights.
    pub tuned_steps: u64,
    /// Steps of the networks that begin with them too but have to learn new outputs, classes, or where the unknown lies (`metric-open`,
    /// our own, `supervised`), and of the closed set, with which these are compared. Four times as many on streets, where our own gains
    /// 13 points of AP of the unknown from them on validation scans.
    pub longer_steps: u64,
    /// Frames a step.
    pub batch: u32,
    /// Validation scans that the trainer judges on.
    pub validate_frames: u32,
    /// Draws of the bootstrap.
    pub resamples: usize,
}

impl Size {
    /// Name on the command line and in the report.
    pub fn name(self) -> &'static str {
        match self {
            Size::Full => "full",
            Size::Quick => "quick",
            Size::Smoke => "smoke",
        }
    }

    /// The table.
    pub fn sizes(self, setting: Setting) -> Sizes {
        let udi = setting == Setting::SimUdi;
        match self {
            Size::Full => Sizes {
                train_frames: 2500,
                supervised_frames: 2000,
                val_frames: 400,
                test_frames: 1000,
                base_steps: if udi { 4000 } else { 4400 },
                tuned_steps: 500,
                longer_steps: if udi { 1000 } else { 4000 },
                batch: 2,
                validate_frames: 60,
                resamples: 500,
            },
            Size::Quick => Sizes {
                train_frames: 150,
                supervised_frames: 100,
                val_frames: 10,
                test_frames: 50,
                base_steps: if udi { 150 } else { 220 },
                tuned_steps: if udi { 30 } else { 40 },
                longer_steps: if udi { 30 } else { 40 },
                batch: 2,
                validate_frames: 0,
                resamples: 200,
            },
            Size::Smoke => Sizes {
                train_frames: 6,
                supervised_frames: 6,
                val_frames: 2,
                test_frames: 6,
                base_steps: 2,
                tuned_steps: 2,
                longer_steps: 2,
                batch: 1,
                validate_frames: 0,
                resamples: 20,
            },
        }
    }
}
