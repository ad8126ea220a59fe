//! Non-maximum suppression over all candidates: any two boxes that overlap, whatever their class.

use mluc_geometry::{Box3, nms_into};

/// Memory between frames.
#[derive(Clone, Debug, Default)]
pub(crate) struct Suppressor {
    order: Vec<usize>,
    without_class: Vec<usize>,
    /// Indices of the kept boxes, best first; those without a class last.
    pub(crate) kept: Vec<usize>,
}

impl Suppressor {
    /// For as many boxes.
    pub(crate) fn new(boxes: usize) -> Suppressor {
        Suppressor {
            order: Vec::with_capacity(boxes),
            without_class: Vec::with_capacity(boxes),
            kept: Vec::with_capacity(boxes),
        }
    }

    /// `boxes` best first. Boxes without a class suppress each other alone and come last. At most `boxes_max` stay; gives how
    /// many of them have no class.
    pub(crate) fn run(
        &mut self,
        boxes: &[Box3],
        has_class: impl Fn(usize) -> bool,
        iou_max: f64,
        boxes_max: usize,
    ) -> usize {
        let (order, kept, without) = (&mut self.order, &mut self.kept, &mut self.without_class);
        order.clear();
        order.extend((0..boxes.len()).filter(|&index| has_class(index)));
        nms_into(boxes, order, iou_max, boxes_max, kept);
        order.clear();
        order.extend((0..boxes.len()).filter(|&index| !has_class(index)));
        nms_into(boxes, order, iou_max, boxes_max - kept.len(), without);
        kept.extend_from_slice(without);
        without.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_suppress_each_other_and_those_without_a_class_alone() {
        let boxes = [0.0, 0.5, 1.0, 20.0].map(|x| Box3::new([x, 0.0, 0.0, 4.0, 2.0, 1.5, 0.0]));
        let mut suppressor = Suppressor::default();
        assert_eq!(suppressor.run(&boxes, |_| true, 0.1, 10), 0);
        assert_eq!(suppressor.kept, [0, 3]);
        assert_eq!(suppressor.run(&boxes, |index| index % 2 == 0, 0.1, 10), 2);
        assert_eq!(suppressor.kept, [0, 1, 3]);
        assert_eq!(suppressor.run(&boxes, |index| index % 2 == 0, 0.1, 2), 1);
        assert_eq!(suppressor.kept, [0, 1]);
    }
}
