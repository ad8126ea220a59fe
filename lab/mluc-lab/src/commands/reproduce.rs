//! `mluc-lab reproduce`: the paper's tables with one command.

use super::terminal::{Progress, Threads, one_of, print_out};
use super::train::commit;
use anyhow::{Context, ensure};
use clap::Args;
use mluc_dataset::Splits;
use mluc_reproduce::{Layout, Options, Screen, Setting, Size, run};
use std::path::PathBuf;

/// Simulate, train and evaluate what is missing, and write the report: the paper's tables and figures beside ours.
///
/// Every step leaves its outcome in a folder, so a run that was interrupted goes on where it stopped, and networks that lie
/// in --runs already are taken as they are: RUNS/sim-udi/{metric,sigmoid,softmax,metric-open,mluc-full,supervised,osis}/model.safetensors,
/// further seeds in metric-s2 and so on. The full plan takes hours on two cores; --quick twelve minutes.
#[derive(Args)]
pub(crate) struct ReproduceArguments {
    /// Only this setting: udi (industrial park, all around) or kitti (streets, ahead) [default: both, simulated].
    #[arg(long, value_parser = one_of(&[Setting::SimUdi, Setting::SimKitti], Setting::trainer_name), conflicts_with = "dataset")]
    setting: Option<Setting>,
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
    /// Recorded scans in KITTI's format on which the rows of sim-kitti are shown too, nothing being chosen on them. Can be repeated.
    #[arg(long, value_name = "DIR")]
    real: Vec<PathBuf>,
    /// Tables on KITTI's object benchmark instead: needs --root.
    #[arg(long, value_parser = ["kitti"], requires = "root")]
    dataset: Option<String>,
    /// Folder of KITTI's object benchmark: training/ with velodyne, label_2 and calib; ImageSets with train.txt and val.txt.
    #[arg(long, value_name = "DIR", requires = "dataset")]
    root: Option<PathBuf>,
    /// Folder with train.txt and val.txt [default: ImageSets in or beside --root].
    #[arg(long, value_name = "DIR", requires = "dataset")]
    splits: Option<PathBuf>,
    #[command(flatten)]
    threads: Threads,
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
        let settings = match (&self.dataset, self.setting) {
            (Some(_), _) => vec![Setting::Kitti],
            (None, Some(setting)) => vec![setting],
            (None, None) => vec![Setting::SimUdi, Setting::SimKitti],
        };
        ensure!(
            self.real.is_empty() || settings.contains(&Setting::SimKitti),
            "--real: expected --setting kitti or both settings, found others"
        );
        let kitti = self.root.as_ref().map(|root| Splits {
            root: root.clone(),
            folder: self.splits.clone(),
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
            commit: commit(),
            command: self.command(size),
            real: self.real.clone(),
            kitti,
        })
    }

    /// The command as a reader would repeat it: without folders of this machine.
    fn command(&self, size: Size) -> String {
        let mut text = "mluc-lab reproduce".to_owned();
        if let Some(dataset) = &self.dataset {
            text += &format!(" --dataset {dataset} --root DIR");
            text += self.splits.as_ref().map_or("", |_| " --splits DIR");
        } else if let Some(setting) = self.setting {
            text += &format!(" --setting {}", setting.trainer_name());
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
        text + &" --real DIR".repeat(self.real.len())
    }
}

pub(crate) fn run_command(arguments: ReproduceArguments) -> anyhow::Result<()> {
    arguments.threads.start()?;
    let options = arguments.options()?;
    let style = "{prefix} {msg} [{bar:30}] {pos}/{len}, {eta} left of this";
    let screen = Progress::new("", 0, style);
    run(&options, &screen)?;
    screen.clear();
    print_out(options.layout.out.join("README.md").display())
}

impl Screen for Progress {
    fn step(&self, number: usize, steps: usize, name: &str) {
        let step = format!("[{number}/{steps}]");
        Progress::note(self, &format!("{step} {name}"));
        self.bar.set_prefix(step);
    }

    fn count(&self, what: &str, total: u64) {
        self.wait_with_lines();
        self.bar.reset();
        self.bar.set_length(total);
        self.bar.set_message(what.to_owned());
    }

    fn tick(&self) {
        self.bar.inc(1);
        let bar = &self.bar;
        let (step, what, done) = (bar.prefix(), bar.message(), bar.position());
        let total = bar.length().unwrap_or(done);
        self.line(false, format_args!("{step} {what}: {done}/{total}"));
    }

    fn note(&self, text: &str) {
        Progress::note(self, text);
    }

    fn clear(&self) {
        self.bar.set_length(0);
        self.bar.finish_and_clear();
    }
}
