//! What the tests of whole pipelines share: a model without training, synthetic scans, running the program `mluc`.

mod foreign;
mod inputs;
mod oracle;
mod pipeline;
mod skip;

pub use foreign::{cpp_refiner, python_refiner};
pub use inputs::{Setting, car_scan, clean_folder, read_json, untrained_model, write_scan};
pub use oracle::oracle;
pub use pipeline::{
    Finished, Pipeline, built_program, leftovers, mluc_program, send_signal, unique_instance,
};
pub use skip::{data_folder, skip};
