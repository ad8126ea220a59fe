//! A C interface for your own source, refiner or consumer, in any language that can call C: `include/mluc.h` describes it,
//! `docs/CONTRACT.md` says what these programs must do. This crate does the part that is the same for all: joining,
//! waiting, checking what came in, finding the points of a frame, stamps, health, leaving.
//!
//! Open, wait, publish, close, and the words of the last error. A handle belongs to one thread at a time.

mod calls;
mod consumer;
mod error;
mod refiner;
mod source;

pub use calls::{
    MlucConsumer, MlucFrame, MlucRefiner, MlucResult, MlucSource, mluc_consumer_close,
    mluc_consumer_open, mluc_consumer_wait, mluc_last_error, mluc_refiner_close, mluc_refiner_open,
    mluc_refiner_publish, mluc_refiner_wait, mluc_source_close, mluc_source_finish,
    mluc_source_open, mluc_source_publish, mluc_source_wait, mluc_wire_version,
};
pub use error::Code;
