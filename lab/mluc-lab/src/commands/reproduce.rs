//! `mluc-lab reproduce`: the paper's tables with one command.

use super::terminal::{Threads, bar, print_err, print_out};
use anyhow::{Context, bail};
use clap::{Args, ValueEnum};
use indicatif::ProgressBar;
use mluc_dataset::UnknownPolicy;
use mluc_reproduce::{KittiSource, Layout, Options, Screen, Setting, Size, run};
use std::io::IsTerminal;
use std::path::PathBuf;
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// Simulate, train and evaluate what is missing, and write the report: the paper's tables and figures beside ours.
///
/// Every step leaves its outcome in a folder, so a run that was interrupted goes on where it stopped, and networks that lie
/// in --runs already are taken as they are: RUNS/sim-udi/{metric,sigmoid,softmax,metric-open,mluc-full,supervised,osis}/model.safetensors,
/// further seeds in metric-s2 and so on. The full plan takes hours on two cores; --quick twelve minutes.
#[derive(Args)]
pub(crate) struct ReproduceArguments {
    /// Only this setting [default: both simulated ones].
    #[arg(long, value_enum)]
    setting: Option<SettingName>,
    /// Networks of the kinds that naive, MLUC and mluc-full run on: their rows then have a spread over seeds.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=20))]
    seeds: u64,
    /// A few small scans and a few steps: shows that everything works; the figures mean little.
    #[arg(long)]
    quick: bool,
    /// Smaller still, for tests.
    #[arg(long, hide = true)]
    smoke: bool,
    /// Judge on so many test scans instead of the plan's number.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=1_000_000))]
    test_frames: Option<u32>,
    /// Train nothing: rows whose network does not lie in --runs are left out.
    #[arg(long)]
    no_train: bool,
    /// Folder of the report [default: RUNS/report].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Folder of data sets, simulated where missing [default: data, with --quick data/quick].
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Folder of networks and evaluations [default: runs, with --quick runs/quick].
    #[arg(long, value_name = "DIR")]
    runs: Option<PathBuf>,
    /// Recorded scans in KITTI's format on which the rows of sim-kitti are shown too, nothing being chosen on them. Can be
    /// repeated.
    #[arg(long, value_name = "DIR")]
    real: Vec<PathBuf>,
    /// Tables on a recorded benchmark instead: needs --root.
    #[arg(long, value_enum, requires = "root")]
    dataset: Option<DatasetName>,
    /// Folder of KITTI's object benchmark: training/ with velodyne, label_2 and calib; ImageSets with train.txt and val.txt.
    #[arg(long, value_name = "DIR", requires = "dataset")]
    root: Option<PathBuf>,
    /// Folder with train.txt and val.txt [default: ImageSets in or beside --root].
    #[arg(long, value_name = "DIR", requires = "dataset")]
    splits: Option<PathBuf>,
    /// What training sees of vans and trucks.
    #[arg(long, value_enum, default_value_t = PolicyName::DropFrames)]
    policy: PolicyName,
    #[command(flatten)]
    threads: Threads,
}

#[derive(Clone, Copy, ValueEnum)]
enum SettingName {
    /// Industrial park, all around.
    Udi,
    /// Streets, ahead.
    Kitti,
}

#[derive(Clone, Copy, ValueEnum)]
enum DatasetName {
    /// KITTI's object benchmark.
    Kitti,
}

#[derive(Clone, Copy, ValueEnum)]
pub(super) enum PolicyName {
    /// Frames with a van or truck are left out (fits the paper's counts).
    #[value(name = "drop_frames")]
    DropFrames,
    /// Their points are deleted and their place ignored.
    Erase,
    /// Their points stay as background: wrong for open sets, for comparison.
    Background,
}

impl PolicyName {
    pub(super) fn policy(self) -> UnknownPolicy {
        match self {
            PolicyName::DropFrames => UnknownPolicy::DropFrames,
            PolicyName::Erase => UnknownPolicy::Erase,
            PolicyName::Background => UnknownPolicy::Background,
        }
    }
}

impl ReproduceArguments {
    fn options(&self) -> anyhow::Result<Options> {
        let size = match (self.smoke, self.quick) {
            (true, _) => Size::Smoke,
            (false, true) => Size::Quick,
            (false, false) => Size::Full,
        };
        let below = |folder: &str| match size {
            Size::Full => PathBuf::from(folder),
            _ => PathBuf::from(folder).join(size.name()),
        };
        let runs = self.runs.clone().unwrap_or_else(|| below("runs"));
        let settings = match (self.dataset, self.setting) {
            (Some(DatasetName::Kitti), None) => vec![Setting::Kitti],
            (Some(_), Some(_)) => bail!("--setting: expected none beside --dataset, found one"),
            (None, Some(SettingName::Udi)) => vec![Setting::SimUdi],
            (None, Some(SettingName::Kitti)) => vec![Setting::SimKitti],
            (None, None) => vec![Setting::SimUdi, Setting::SimKitti],
        };
        let kitti = self.root.as_ref().map(|root| KittiSource {
            root: root.clone(),
            splits: self.splits.clone(),
            policy: self.policy.policy(),
        });
        Ok(Options {
            layout: Layout {
                data: self.data.clone().unwrap_or_else(|| below("data")),
                out: self.out.clone().unwrap_or_else(|| runs.join("report")),
                runs,
            },
            settings,
            size,
            test_frames: self.test_frames,
            seeds: self.seeds,
            train: !self.no_train,
            program: std::env::current_exe().context("the path of this program")?,
            commit: super::train::commit().unwrap_or_else(|| "unknown".into()),
            command: self.command(size),
            real: self.real.clone(),
            kitti,
        })
    }

    /// The command as a reader would repeat it: without folders of this machine.
    fn command(&self, size: Size) -> String {
        let mut text = "mluc-lab reproduce".to_owned();
        match (self.dataset, self.setting) {
            (Some(_), _) => {
                let policy = self.policy.policy().name();
                text += &format!(" --dataset kitti --root DIR --policy {policy}");
            }
            (None, Some(SettingName::Udi)) => text += " --setting udi",
            (None, Some(SettingName::Kitti)) => text += " --setting kitti",
            (None, None) => {}
        }
        if self.seeds > 1 {
            text += &format!(" --seeds {}", self.seeds);
        }
        if size != Size::Full {
            text += &format!(" --{}", size.name());
        }
        if let Some(frames) = self.test_frames {
            text += &format!(" --test-frames {frames}");
        }
        if self.no_train {
            text += " --no-train";
        }
        text
    }
}

/// Runs it.
pub(crate) fn run_command(arguments: ReproduceArguments) -> anyhow::Result<()> {
    arguments.threads.start()?;
    let options = arguments.options()?;
    let bars = Bars::new();
    run(&options, &bars)?;
    bars.clear();
    print_out(options.layout.out.join("README.md").display())
}

/// Without a terminal, a line this often.
const LINE_EVERY: Duration = Duration::from_secs(30);

/// A bar for the part that runs, with the step in front; lines where there is no terminal. All on stderr.
struct Bars {
    terminal: bool,
    bar: ProgressBar,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    step: String,
    what: String,
    total: u64,
    done: u64,
    /// When the last line was printed, or the part began.
    last: Option<Instant>,
}

impl Bars {
    fn new() -> Bars {
        Bars {
            terminal: std::io::stderr().is_terminal(),
            bar: bar("", 0, "{msg} [{bar:30}] {pos}/{len}, {eta} left of this"),
            state: Mutex::default(),
        }
    }

    fn state(&self) -> std::sync::MutexGuard<'_, State> {
        self.state
            .lock()
            .unwrap_or_else(std::sync::PoisonError::into_inner)
    }
}

impl Screen for Bars {
    fn step(&self, number: usize, steps: usize, name: &str, left_s: f64) {
        let text = format!(
            "[{number}/{steps}] {name}; about {:.0} min left in all",
            left_s / 60.0
        );
        self.note(&text);
        self.state().step = format!("[{number}/{steps}]");
    }

    fn count(&self, what: &str, total: u64) {
        let mut state = self.state();
        (state.what, state.total, state.done) = (what.to_owned(), total, 0);
        state.last = Some(Instant::now());
        self.bar.reset();
        self.bar.set_length(total);
        self.bar.set_message(format!("{} {what}", state.step));
    }

    fn tick(&self) {
        self.bar.inc(1);
        if self.terminal {
            return;
        }
        let mut state = self.state();
        state.done += 1;
        if state.last.is_none_or(|last| last.elapsed() >= LINE_EVERY) {
            state.last = Some(Instant::now());
            print_err(format_args!(
                "{} {}: {}/{}",
                state.step, state.what, state.done, state.total
            ));
        }
    }

    fn note(&self, text: &str) {
        if self.terminal {
            self.bar.println(text);
        } else {
            print_err(text);
        }
    }

    fn clear(&self) {
        self.bar.set_length(0);
        self.bar.finish_and_clear();
    }
}
