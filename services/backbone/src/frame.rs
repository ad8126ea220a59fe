//! What a frame gave.

use crate::voxelize::PointCounts;

/// What a frame gave.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Frame {
    /// What became of the points.
    pub points: PointCounts,
    /// Feature rows to be written.
    pub rows: usize,
}
