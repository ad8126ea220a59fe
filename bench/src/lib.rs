//! Measurements of mluc: the program `mluc-bench`, and what the other measuring programs of this folder share.

pub mod clock;
pub mod inputs;
pub mod machine;
mod report;
mod run;
mod svg;
pub mod transport;

pub use run::program;
