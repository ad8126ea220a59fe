//! The parts of the contract, one function each.

mod frames;
mod garbage;
mod life;
mod overload;
mod runs;
mod version;

use crate::refiner::session::Session;

/// What was seen when it passed; why not when it failed.
pub(crate) type Outcome = anyhow::Result<String>;

/// One part of the contract.
pub(crate) struct Case {
    pub(crate) name: &'static str,
    pub(crate) asks: &'static str,
    pub(crate) run: fn(&mut Session<'_>) -> Outcome,
}

const fn case(
    name: &'static str,
    asks: &'static str,
    run: fn(&mut Session<'_>) -> Outcome,
) -> Case {
    Case { name, asks, run }
}

/// In the order they run.
pub(crate) const CASES: [Case; 18] = [
    case(
        "start",
        "a heartbeat says that it takes frames, and what it waits for",
        life::start,
    ),
    case(
        "scene",
        "each detection has its object in its place; known ones pass unchanged; header, stamps and points are in order",
        frames::scene,
    ),
    case(
        "empty",
        "frames without points, without detections, without both are answered",
        frames::empty,
    ),
    case(
        "candidates_512",
        "512 candidates, on one spot and spread, are answered",
        frames::candidates,
    ),
    case(
        "points_262144",
        "262,144 points, as a scene and as one dense cloud, are answered",
        frames::points,
    ),
    case(
        "points_gone",
        "a frame whose points are gone is answered, flagged points_gone and degraded",
        frames::points_gone,
    ),
    case(
        "sent_again",
        "a frame that is sent again is answered again",
        frames::sent_again,
    ),
    case(
        "sequences",
        "a sequence that ingest has not sent, or that goes back, is refused; sound frames after it are answered",
        runs::sequences,
    ),
    case(
        "other_run",
        "frames and points of another run are not used",
        runs::other_run,
    ),
    case(
        "new_run",
        "a new run is joined, its sequences begin at 0, and frames of the run before are refused",
        runs::new_run,
    ),
    case(
        "overload",
        "the newest frame wins; those that were overtaken are counted in frames_dropped",
        overload::overload,
    ),
    case(
        "garbage_lengths",
        "messages longer than the limits end nothing and are flagged or refused",
        garbage::lengths,
    ),
    case(
        "garbage_numbers",
        "indices and enums out of range, NaN, infinite and negative numbers end nothing and are flagged or refused",
        garbage::numbers,
    ),
    case(
        "garbage_noise",
        "random bytes in shared memory end nothing",
        garbage::noise,
    ),
    case(
        "wrong_version",
        "another wire version is refused with both versions: a message by health, an instance by ending with an error",
        version::wrong_version,
    ),
    case(
        "silence",
        "without input it stays alive, and health says that it waits",
        life::silence,
    ),
    case(
        "restart",
        "killed and started again, it goes on without help",
        life::restart,
    ),
    case("stop", "SIGTERM ends it, with exit code 0", life::stop),
];

/// Names of all cases.
pub(crate) fn names() -> [&'static str; CASES.len()] {
    CASES.each_ref().map(|case| case.name)
}
