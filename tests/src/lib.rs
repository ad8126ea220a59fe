//! Common parts of the pipeline tests: a model without training, synthetic scans, running the program `mluc`, external reference data.

// A comment says only what a name does not say.
#![allow(missing_docs)]

mod inputs;
mod outside;
mod running;

pub use inputs::{
    NO_CAMERA, Setting, car_scan, read_json, root, untrained_model, untrained_udi, write_file,
};
pub use outside::{
    PaperFrame, cpp_example, data_folder, feature_map, oracle, paper_frames, paper_network,
    python_example, python_script, python_with, rms, skip,
};
pub use running::{
    Finished, Running, assert_has, built_program, is_alive, leftovers, mluc_program, send_signal,
    unique_instance, wait_for,
};
