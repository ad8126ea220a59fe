//! What training on recorded scans sees of objects that are to stay unknown. The paper does not say; its object counts fit the first.

use super::Label;
use mluc_geometry::Box3;

/// An erased box is that much larger on every side, m: drawn boxes are not exact.
pub const ERASE_MARGIN_M: f64 = 0.2;

/// What becomes of unknown objects in training frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UnknownPolicy {
    /// A: frames with any unknown object are left out. No leakage of any kind; fits the paper's counts.
    DropFrames,
    /// B: their points are deleted, their place is ignored. More data; their shadows stay.
    Erase,
    /// C: points stay, labels go: unknown objects are trained as background. Wrong for open sets; for comparison.
    Background,
}

impl UnknownPolicy {
    /// All of them.
    pub const ALL: [UnknownPolicy; 3] = [
        UnknownPolicy::DropFrames,
        UnknownPolicy::Erase,
        UnknownPolicy::Background,
    ];

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        ["drop_frames", "erase", "background"][self as usize]
    }

    /// Whether a frame with these labels is trained on; `unknown` are the classes that are to stay unknown.
    pub fn keeps_frame(self, labels: &[Label], unknown: &[String]) -> bool {
        self != UnknownPolicy::DropFrames || !labels.iter().any(|label| is_unknown(label, unknown))
    }

    /// Whether a label is written for the trainer. One of a class that the trainer does not know makes it ignore the place.
    pub fn keeps_label(self, class: &str, unknown: &[String]) -> bool {
        let is_unknown = unknown.iter().any(|name| name.eq_ignore_ascii_case(class));
        self != UnknownPolicy::Background || !is_unknown
    }
}

/// Whether a label is of one of these classes.
pub(super) fn is_unknown(label: &Label, unknown: &[String]) -> bool {
    unknown.iter().any(|name| label.is(name))
}

/// Deletes the points in boxes (sensor frame), each enlarged by [`ERASE_MARGIN_M`] on every side.
pub fn erase(points: &mut Vec<[f32; 4]>, boxes: &[Box3]) {
    let enlarged = boxes.iter().map(|b| Box3 {
        size_m: b.size_m.map(|s| s + 2.0 * ERASE_MARGIN_M),
        ..*b
    });
    let enlarged: Vec<Box3> = enlarged.collect();
    points.retain(|point| !enlarged.iter().any(|b| b.has_point(point)));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_in_and_just_beside_a_box_go() {
        let b = Box3::new([10.0, 0.0, 0.0, 4.0, 2.0, 2.0, 0.0]);
        let mut points = vec![
            [10.0, 0.0, 0.0, 0.5],
            [12.1, 0.0, 0.0, 0.5],
            [12.3, 0.0, 0.0, 0.5],
            [0.0; 4],
        ];
        erase(&mut points, &[b]);
        assert_eq!(points, [[12.3, 0.0, 0.0, 0.5], [0.0; 4]]);
    }
}
