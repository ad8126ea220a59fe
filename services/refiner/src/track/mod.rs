//! Temporal voting: unknown objects are followed over frames, and published once enough of the last frames saw them.
//!
//! A bush that looks like an object in one frame seldom does so in the next; a golf cart does. Known objects are not
//! looked at and never delayed.

mod settings;
mod tracker;

pub use settings::TrackSettings;
pub use tracker::Tracker;
