//! What happens off the vehicle: simulate, train, evaluate, draw.

pub mod dataset;
pub mod evaluate;
pub mod pipeline;
pub mod render;
pub mod simulate;
pub mod statistics;
pub mod train;
