//! The parts of the contract, one function each.

mod frames;
mod garbage;
mod life;
mod runs;

use crate::refiner::session::Session;

/// What was seen when it passed; why not when it failed.
pub(crate) type Outcome = anyhow::Result<String>;

pub(crate) struct Case {
    pub(crate) name: &'static str,
    pub(crate) run: fn(&mut Session<'_>) -> Outcome,
}

impl Case {
    /// What the contract asks there.
    pub(crate) fn asks(&self) -> &'static str {
        let mut lines = include_str!("asks.txt").lines();
        let asks = lines.find_map(|line| line.strip_prefix(self.name)?.strip_prefix(": "));
        asks.expect("a line for every case")
    }
}

const fn case(name: &'static str, run: fn(&mut Session<'_>) -> Outcome) -> Case {
    Case { name, run }
}

/// In the order they run.
pub(crate) const CASES: [Case; 18] = [
    case("start", life::start),
    case("scene", frames::scene),
    case("empty", frames::empty),
    case("candidates_512", frames::candidates),
    case("points_262144", frames::points),
    case("points_gone", frames::points_gone),
    case("sent_again", frames::sent_again),
    case("sequences", runs::sequences),
    case("other_run", runs::other_run),
    case("new_run", runs::new_run),
    case("overload", life::overload),
    case("garbage_lengths", garbage::lengths),
    case("garbage_numbers", garbage::numbers),
    case("garbage_noise", garbage::noise),
    case("wrong_version", runs::wrong_version),
    case("silence", life::silence),
    case("restart", life::restart),
    case("stop", life::stop),
];
