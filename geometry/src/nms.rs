//! Greedy non-maximum suppression by rotated overlap in bird's-eye view.

use crate::boxes::Box3;
use crate::overlap::iou_bev;

/// Keeps a box when its rotated BEV IoU with every box kept before is at most `iou_max`.
///
/// `order` holds indices into `boxes`, best first; indices beyond the boxes are passed over. `kept` is emptied, then takes
/// at most `kept_max` indices, best first: no allocation when that is its capacity.
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
        let is_free = |&other: &usize| iou_bev(&boxes[other], candidate) <= iou_max;
        if kept.iter().all(is_free) {
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
        let pair = [at(0.0, 0.0), at(0.5, 0.1), at(10.0, 0.0)];
        // 0 and 1 overlap, 1 and 2 overlap, 0 and 2 do not: a suppressed box does not suppress.
        let chain = [at(0.0, 0.0), at(3.0, 0.0), at(6.0, 0.0)];
        let kept = |boxes: &[Box3], order: &[usize], iou_max: f64, kept_max: usize| {
            let mut kept = vec![9];
            nms_into(boxes, order, iou_max, kept_max, &mut kept);
            kept
        };
        assert_eq!(kept(&pair, &[1, 0, 2], 0.1, 10), [1, 2]);
        assert_eq!(kept(&pair, &[0, 1, 2], 0.1, 10), [0, 2]);
        assert_eq!(kept(&pair, &[0, 1, 2], 0.1, 1), [0]);
        assert_eq!(kept(&pair, &[0, 1, 2], 0.99, 10), [0, 1, 2]);
        assert_eq!(kept(&chain, &[0, 1, 2], 0.0, 10), [0, 2]);
        assert!(kept(&[], &[], 0.5, 10).is_empty());
        // An index beyond the boxes.
        assert_eq!(kept(&pair[..1], &[7, 0], 0.5, 10), [0]);
    }
}
