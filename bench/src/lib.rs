//! What the benchmarks share: the machine that a figure belongs to, scans and models to measure on, charts.

pub mod chart;
pub mod inputs;
pub mod machine;
