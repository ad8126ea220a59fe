//! Non-maximum suppression over all candidates, or class by class.

use mluc_geometry::{Box3, nms_into};

/// Which boxes suppress each other.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Suppression {
    /// Any two that overlap.
    #[default]
    Agnostic,
    /// Those of one class: overlapping boxes of several classes stay, as an unknown object gives them.
    PerClass,
}

/// Memory between frames.
#[derive(Clone, Debug, Default)]
pub(crate) struct Suppressor {
    order: Vec<usize>,
    of_class: Vec<usize>,
    /// Indices of the kept boxes, best first.
    pub(crate) kept: Vec<usize>,
}

impl Suppressor {
    /// For as many boxes.
    pub(crate) fn new(boxes: usize) -> Suppressor {
        Suppressor {
            order: Vec::with_capacity(boxes),
            of_class: Vec::with_capacity(boxes),
            kept: Vec::with_capacity(boxes),
        }
    }

    /// `boxes` best first; `class(i)` below `classes`, or equal to it for a box of no class. Boxes of no class suppress
    /// each other alone and come last. At most `boxes_max` stay; gives how many of them have no class.
    pub(crate) fn run(
        &mut self,
        mode: Suppression,
        boxes: &[Box3],
        (class, classes): (impl Fn(usize) -> usize, usize),
        iou_max: f64,
        boxes_max: usize,
    ) -> usize {
        let Suppressor {
            order,
            of_class,
            kept,
        } = self;
        order.clear();
        match mode {
            Suppression::Agnostic => {
                order.extend((0..boxes.len()).filter(|index| class(*index) < classes));
                nms_into(boxes, order, iou_max, boxes_max, kept);
            }
            Suppression::PerClass => {
                kept.clear();
                let mut all = std::mem::take(kept);
                for wanted in 0..classes {
                    order.clear();
                    order.extend((0..boxes.len()).filter(|index| class(*index) == wanted));
                    nms_into(boxes, order, iou_max, boxes_max, of_class);
                    all.extend_from_slice(of_class);
                }
                all.sort_unstable();
                all.truncate(boxes_max);
                *kept = all;
            }
        }
        order.clear();
        order.extend((0..boxes.len()).filter(|index| class(*index) == classes));
        nms_into(boxes, order, iou_max, boxes_max - kept.len(), of_class);
        kept.extend_from_slice(of_class);
        of_class.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn classes_suppress_across_or_only_within() {
        let boxes = [0.0, 0.5, 1.0, 20.0].map(|x| Box3::new([x, 0.0, 0.0, 4.0, 2.0, 1.5, 0.0]));
        let class = |index: usize| [0, 1, 0, 1][index];
        let mut suppressor = Suppressor::default();
        suppressor.run(Suppression::Agnostic, &boxes, (class, 2), 0.1, 10);
        assert_eq!(suppressor.kept, [0, 3]);
        suppressor.run(Suppression::PerClass, &boxes, (class, 2), 0.1, 10);
        assert_eq!(suppressor.kept, [0, 1, 3]);
        suppressor.run(Suppression::PerClass, &boxes, (class, 2), 0.1, 2);
        assert_eq!(suppressor.kept, [0, 1]);
        // With one class, class 1 is none: those boxes suppress each other alone, and come last.
        let generic = suppressor.run(Suppression::Agnostic, &boxes, (class, 1), 0.1, 10);
        assert_eq!((generic, &suppressor.kept[..]), (2, &[0, 1, 3][..]));
    }
}
