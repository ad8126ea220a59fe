//! What tests share.

use mluc_ipc_types::Point;

use crate::FrameIndex;

pub(crate) fn point([x_m, y_m, z_m]: [f32; 3]) -> Point {
    Point {
        x_m,
        y_m,
        z_m,
        intensity: 0.0,
    }
}

pub(crate) fn sorted(scan: &[Point]) -> FrameIndex {
    let mut frame = FrameIndex::default();
    frame.sort(scan);
    frame
}
