//! The subcommands.

mod demo;
mod doctor;
mod exec;
mod status;
mod up;

pub(crate) use demo::demo;
pub(crate) use doctor::doctor;
pub(crate) use exec::exec;
pub(crate) use status::status;
pub(crate) use up::up;
