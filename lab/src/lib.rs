//! What happens off the vehicle: simulate, train, evaluate, draw.

pub mod dataset;
pub mod train;
