//! The three difficulties and three metrics of the devkit.

use mluc_dataset::Label;

/// Which labelled objects count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Difficulty {
    /// 40 px high or more, not occluded, at most 15 % outside the image.
    Easy,
    /// 25 px, partly occluded, 30 %.
    Moderate,
    /// 25 px, largely occluded, 50 %.
    Hard,
}

mluc_ipc_types::values!(Difficulty: Easy "easy" Moderate "moderate" Hard "hard");

impl Difficulty {
    /// Least height of the image box, px.
    fn height_min_px(self) -> f64 {
        [40.0, 25.0, 25.0][self as usize]
    }

    /// Whether an object is easy enough to count as missed when it is not found.
    pub fn takes(self, label: &Label) -> bool {
        let height_px = label.image_box_px[3] - label.image_box_px[1];
        // Labels of scans without a camera have no image box.
        let is_seen = label.image_box_px == [0.0; 4] || height_px >= self.height_min_px();
        label.occluded <= [0, 1, 2][self as usize]
            && label.truncated <= [0.15, 0.30, 0.50][self as usize]
            && is_seen
    }

    /// Whether a detection is too small in the image to count; the devkit truncates its height to whole pixels.
    pub fn is_too_small(self, detection: &Label) -> bool {
        let [_, top, _, bottom] = detection.image_box_px;
        detection.image_box_px != [0.0; 4] && (bottom - top).abs().trunc() < self.height_min_px()
    }
}

/// The shapes whose overlap is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Metric {
    /// Boxes in the image (2D).
    Image,
    /// Rotated footprints seen from above (bird's-eye view).
    Bev,
    /// Volumes (3D boxes).
    Space,
}

impl Metric {
    pub(crate) const ALL: [Metric; 3] = [Metric::Image, Metric::Bev, Metric::Space];

    pub(crate) fn name(self) -> &'static str {
        ["2d", "bev", "3d"][self as usize]
    }
}
