//! The parts of the contract, one function each.

mod frames;
mod garbage;
mod life;
mod runs;

use crate::refiner::session::Session;
pub(crate) use crate::suite::{Case, Outcome};

/// The cases in the order in which they run.
pub(crate) const CASES: &[Case<Session>] = &[
    ("start", life::start),
    ("scene", frames::scene),
    ("empty", frames::empty),
    ("candidates_512", frames::candidates),
    ("points_262144", frames::points),
    ("points_gone", frames::points_gone),
    ("sent_again", frames::sent_again),
    ("sequences", runs::sequences),
    ("other_run", runs::other_run),
    ("new_run", runs::new_run),
    ("overload", life::overload),
    ("garbage_lengths", garbage::lengths),
    ("garbage_numbers", garbage::numbers),
    ("garbage_noise", garbage::noise),
    ("wrong_version", runs::wrong_version),
    ("silence", life::silence),
    ("restart", life::restart),
    ("stop", |s| s.tested.terminate()),
];
