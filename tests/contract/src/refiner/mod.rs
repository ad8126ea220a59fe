//! The suite of the refiner: plays ingest, backbone and head over the same shared memory as the real stages, and checks the answers.

mod answer;
mod cases;
mod player;
mod scene;
mod session;

use crate::program::Options;
use crate::suite::{self, Case, Suite, SuiteArgs, run_command, supervised};
use clap::Args;
use mluc_refiner::Variant;
use mluc_runtime::Instance;
use player::Player;
use session::Session;
use std::process::ExitCode;

#[derive(Args, Clone, Debug)]
pub(crate) struct RefinerArgs {
    /// Only this variant of our own refiner.
    #[arg(long, value_name = "VARIANT", conflicts_with = "command")]
    refiner_variant: Option<String>,
    #[command(flatten)]
    suite: SuiteArgs,
}

impl Suite for Player {
    const CASES: &'static [Case<Session>] = cases::CASES;
    const ASKS: &'static str = include_str!("cases/asks.txt");

    fn new(instance: &Instance, options: &Options) -> anyhow::Result<Player> {
        Player::new(instance, options)
    }

    fn ready(session: &mut Session) -> anyhow::Result<()> {
        if !session.tested.runs() {
            session.start()?;
        }
        session.player.forget_answers()
    }
}

pub(crate) fn run(args: RefinerArgs) -> anyhow::Result<ExitCode> {
    let programs = match &args.refiner_variant {
        _ if !args.suite.command.is_empty() => return run_command::<Player>(&args.suite),
        Some(variant) => vec![own(&args, variant)],
        None => Variant::ALL.map(|one| own(&args, one.name())).into(),
    };
    suite::run::<Player>(&args.suite, programs)
}

/// Title and command of our own refiner in a variant, as `mluc up` starts it.
fn own(args: &RefinerArgs, variant: &str) -> (String, Vec<String>) {
    let model = ["--model", &args.suite.model];
    let words = [["stage", "refiner"], model, ["--refiner-variant", variant]];
    let title = format!("mluc stage refiner, variant {variant}");
    (title, supervised(words.as_flattened(), &[]))
}
