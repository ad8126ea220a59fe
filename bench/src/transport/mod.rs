//! What handing over a message costs between two processes, and its baseline.
//!
//! A figure for our own hop says little by itself: it depends on the machine and its other work. So every figure comes with
//! a baseline of the same run, interleaved with it, with the same payload (see [`Way`]).
//!
//! [`measure`] starts a second process of the same program; call `serve_peer` first in `main`, so that it can be the
//! other side. A round: the sender fills the payload, reads the clock, sends; the receiver, which sleeps,
//! reads the clock when it has the message, then reads all of it. The difference is the latency: filling and
//! reading are not in it, though both leave their mark on the caches, as in the real stages.

mod load;
mod measure;
mod peer;
mod way;

pub use load::{Payload, Settings};
pub use measure::{Latencies, measure};
pub(crate) use peer::serve_peer;
pub use way::Way;
