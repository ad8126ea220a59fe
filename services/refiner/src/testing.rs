//! Helpers for tests.

use crate::FrameIndex;
use mluc_ipc_types::Point;

pub(crate) fn point([x_m, y_m, z_m]: [f32; 3]) -> Point {
    bytemuck::cast([x_m, y_m, z_m, 0.0])
}

/// A simulated scan that is packed with zstd.
pub(crate) fn unpacked(bytes: &[u8]) -> Vec<Point> {
    let bytes = zstd::decode_all(bytes).expect("a packed scan");
    bytes.chunks_exact(size_of::<Point>()).map(bytemuck::pod_read_unaligned).collect()
}

pub(crate) fn sorted(scan: &[Point]) -> FrameIndex {
    let mut frame = FrameIndex::default();
    frame.sort(scan);
    frame
}
