//! What the tests of whole pipelines share: a model without training, synthetic scans, running the program `mluc`,
//! answers from outside.

mod foreign;
mod inputs;
mod oracle;
mod running;
mod skip;

pub use foreign::{cpp_refiner, python_refiner};
pub use inputs::{
    NO_CAMERA, Setting, car_scan, read_json, root, untrained_model, untrained_udi, write_file,
};
pub use oracle::{PaperFrame, feature_map, paper_frames, paper_network, rms};
pub use running::{
    Finished, Running, built_program, is_alive, leftovers, mluc_program, send_signal,
    unique_instance, wait_for,
};
pub use skip::{data_folder, oracle, skip};
