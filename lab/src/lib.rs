//! What happens off the vehicle: simulate, train, evaluate, draw.
#![warn(clippy::print_stdout, clippy::print_stderr)]

pub mod dataset;
pub mod evaluate;
pub mod exchange;
pub mod made_up;
pub mod methods;
pub mod pipeline;
pub mod quantize;
pub mod render;
pub mod report;
pub mod reproduce;
pub mod simulate;
pub mod statistics;
pub mod train;
pub mod whole_file;
