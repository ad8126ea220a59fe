//! A pickle read, not run: protocol 2, which PyTorch writes.
//!
//! A pickle is a program for a stack machine. Its calls are looked up by name in [`Global`]; a name that is not there
//! ends the reading. What comes out is a heap of plain values that refer to each other by index, tensors as places in
//! storages, never as code.
//!
//! Left out: later protocols, objects of classes, sets, bytes. PyTorch needs none of them for tensors.

mod calls;
mod global;
mod machine;
mod object;

pub use global::{Element, Global};
pub use machine::read;
pub use object::{Heap, Id, Object, Storage, TensorPlace};

/// Bytes of a pickle; a checkpoint with its optimiser has some hundred thousand.
pub const PICKLE_BYTES_MAX: usize = 16 << 20;
