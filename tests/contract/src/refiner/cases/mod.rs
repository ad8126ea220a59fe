//! The parts of the contract, one function each.

mod frames;
mod garbage;
mod life;
mod runs;

use crate::refiner::session::Session;
pub(crate) use crate::suite::{Case, Outcome, case};

pub(crate) const ASKS: &str = include_str!("asks.txt");

/// In the order they run.
pub(crate) const CASES: &[Case<Session>] = &[
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
    case("stop", |s| s.tested.terminate()),
];
