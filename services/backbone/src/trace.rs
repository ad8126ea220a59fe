//! Looking at a frame between the layers, for tests against other implementations.

use crate::sites::Sites;

/// Where the rows of a level lie.
#[derive(Clone, Copy, Debug)]
pub enum Place<'a> {
    /// One row a site of a sparse map.
    Sites(&'a Sites),
    /// One row a cell of a map with so many rows (y) and columns (x), in that order.
    Map([usize; 2]),
}

/// The output of one layer.
#[derive(Clone, Copy, Debug)]
pub struct Level<'a> {
    /// `voxels`, `bev`, or the layer's name.
    pub name: &'a str,
    /// Where its rows lie.
    pub place: Place<'a>,
    /// Of a row.
    pub channels: usize,
    /// Row after row.
    pub values: &'a [f32],
}

/// Called with each level of a frame, in order.
pub type Observer<'a> = &'a mut dyn FnMut(Level);
