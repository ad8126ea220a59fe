//! The subcommands.

mod config;
mod demo;
mod doctor;
mod exec;
mod refiner_test;
mod status;
mod up;

pub(crate) use config::config;
pub(crate) use demo::demo;
pub(crate) use doctor::doctor;
pub(crate) use exec::exec;
pub(crate) use refiner_test::refiner_test;
pub(crate) use status::status;
pub(crate) use up::up;
