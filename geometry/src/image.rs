//! Boxes in the image plane: left, top, right, bottom, px.

/// Size of a camera image, px.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ImageSize {
    /// Columns.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
}

impl ImageSize {
    /// The common size of KITTI's left colour images.
    pub const KITTI: ImageSize = ImageSize { width_px: 1242, height_px: 375 };

    /// The part of a box inside the image (0 to width - 1, 0 to height - 1); `None` when there is none.
    pub fn clip(self, b: [f64; 4]) -> Option<[f64; 4]> {
        let [right, bottom] = [self.width_px, self.height_px].map(|px| f64::from(px) - 1.0);
        let [left, top] = [b[0].max(0.0), b[1].max(0.0)];
        let [right, bottom] = [b[2].min(right), b[3].min(bottom)];
        (right > left && bottom > top).then_some([left, top, right, bottom])
    }
}

/// The bounding box of points, px; without points, left and top are +infinity, right and bottom are -infinity.
pub fn pixel_bounds(points_px: impl Iterator<Item = [f64; 2]>) -> [f64; 4] {
    let (most, least) = (f64::INFINITY, f64::NEG_INFINITY);
    points_px.fold([most, most, least, least], |b, [u, v]| {
        [b[0].min(u), b[1].min(v), b[2].max(u), b[3].max(v)]
    })
}

fn area(b: &[f64; 4]) -> f64 {
    (b[2] - b[0]) * (b[3] - b[1])
}

fn intersection(a: &[f64; 4], b: &[f64; 4]) -> f64 {
    let width = a[2].min(b[2]) - a[0].max(b[0]);
    let height = a[3].min(b[3]) - a[1].max(b[1]);
    width.max(0.0) * height.max(0.0)
}

/// Intersection over union of two image boxes.
pub fn iou_2d(a: &[f64; 4], b: &[f64; 4]) -> f64 {
    let common = intersection(a, b);
    let union = area(a) + area(b) - common;
    if common > 0.0 { common / union } else { 0.0 }
}

/// Intersection over the first box's area: the share of the first box that lies in the second one.
pub fn overlap_of_first_2d(a: &[f64; 4], b: &[f64; 4]) -> f64 {
    let common = intersection(a, b);
    if common > 0.0 { common / area(a) } else { 0.0 }
}
