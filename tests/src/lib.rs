//! What the tests of whole pipelines share: a model without training, made-up scans, running the program `mluc`.

mod foreign;
mod inputs;
mod oracle;
mod pipeline;

pub use foreign::{cpp_refiner, python_refiner};
pub use inputs::{car_scan, clean_folder, untrained_model, write_scan};
pub use oracle::oracle;
pub use pipeline::{Finished, Pipeline, leftovers, mluc_program, send_signal, unique_instance};
