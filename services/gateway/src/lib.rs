//! What leaves: JSON lines and pictures, as pure functions of what the pipeline published.

pub mod lines;
pub mod picture;
