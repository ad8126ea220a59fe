//! Greedy non-maximum suppression by rotated overlap in bird's-eye view.

use crate::boxes::Box3;
use crate::overlap::iou_bev;

/// Keeps a box when its rotated BEV IoU with every box kept before is at most `iou_max`.
///
/// `order` holds indices into `boxes`, best first; indices beyond the boxes are passed over. At most `kept_max` boxes
/// are kept. Returns indices into `boxes`, best first.
pub fn nms(boxes: &[Box3], order: &[usize], iou_max: f64, kept_max: usize) -> Vec<usize> {
    let mut kept = Vec::with_capacity(kept_max.min(order.len()));
    nms_into(boxes, order, iou_max, kept_max, &mut kept);
    kept
}

/// [`nms`] into a buffer of the caller, which is emptied first: no allocation when its capacity is `kept_max`.
pub fn nms_into(
    boxes: &[Box3],
    order: &[usize],
    iou_max: f64,
    kept_max: usize,
    kept: &mut Vec<usize>,
) {
    kept.clear();
    for &index in order {
        if kept.len() == kept_max {
            return;
        }
        let Some(candidate) = boxes.get(index) else {
            continue;
        };
        // `iou_bev` rejects by circles around the boxes first, which settles nearly every pair of a scene.
        if kept
            .iter()
            .all(|&other| iou_bev(&boxes[other], candidate) <= iou_max)
        {
            kept.push(index);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(x: f64, yaw: f64) -> Box3 {
        Box3::new([x, 0.0, 0.0, 4.0, 2.0, 1.5, yaw])
    }

    #[test]
    fn the_best_of_an_overlapping_pair_stays() {
        let boxes = [at(0.0, 0.0), at(0.5, 0.1), at(10.0, 0.0)];
        assert_eq!(nms(&boxes, &[1, 0, 2], 0.1, 10), vec![1, 2]);
        assert_eq!(nms(&boxes, &[0, 1, 2], 0.1, 10), vec![0, 2]);
        assert_eq!(nms(&boxes, &[0, 1, 2], 0.1, 1), vec![0]);
        assert_eq!(nms(&boxes, &[0, 1, 2], 0.99, 10), vec![0, 1, 2]);
    }

    #[test]
    fn a_suppressed_box_does_not_suppress() {
        // 0 and 1 overlap, 1 and 2 overlap, 0 and 2 do not.
        let boxes = [at(0.0, 0.0), at(3.0, 0.0), at(6.0, 0.0)];
        assert_eq!(nms(&boxes, &[0, 1, 2], 0.0, 10), vec![0, 2]);
    }

    #[test]
    fn nothing_and_indices_out_of_range() {
        assert!(nms(&[], &[], 0.5, 10).is_empty());
        assert_eq!(nms(&[at(0.0, 0.0)], &[7, 0], 0.5, 10), vec![0]);
    }
}
