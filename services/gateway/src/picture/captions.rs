//! Places a box's text next to the box, and not over another box or its text.

/// Pixels between a box and its text.
const GAP_PX: i64 = 4;

/// The rectangles that are taken, each as left, top, right, bottom, px, and the size of the picture.
#[derive(Debug)]
pub(super) struct Captions {
    size_px: [i64; 2],
    taken: Vec<[i64; 4]>,
}

impl Captions {
    pub(super) fn among(boxes: Vec<[i64; 4]>, picture_px: [usize; 2]) -> Captions {
        Captions { size_px: picture_px.map(|v| v as i64), taken: boxes }
    }

    /// Upper left corner, px, of a text of this size for a box with these bounds: the first free place on the right, on the left (both
    /// from the top down), above, below. If all are taken: to the right of its top. The text stays in the picture if it fits.
    pub(super) fn place(&mut self, bounds: [i64; 4], size_px: [i64; 2]) -> [i64; 2] {
        let ([left, top, right, bottom], [width, height]) = (bounds, size_px);
        let line = height + 2;
        let (to_right, to_left) = (right + GAP_PX, left - GAP_PX - width);
        let lines = 0..=(bottom - top).clamp(0, 400) / line + 1;
        let beside = |x: i64| lines.clone().map(move |i| [x, top - 2 + i * line]);
        let over_and_under = [[left, top - GAP_PX - height], [left, bottom + GAP_PX]];
        let places = beside(to_right).chain(beside(to_left));
        let places = places.chain(over_and_under);
        let mut free = places.filter(|[x, y]| self.is_free([*x, *y, x + width, y + height]));
        let place = free.next().unwrap_or([to_right, top - 2]);
        let within = |i: usize, length: i64| place[i].clamp(0, (self.size_px[i] - length).max(0));
        let [x, y] = [within(0, width), within(1, height)];
        self.taken.push([x, y, x + width, y + height]);
        [x, y]
    }

    fn is_free(&self, a: [i64; 4]) -> bool {
        let covers = |b: &[i64; 4]| a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3];
        let fits = |axis: usize| a[axis] >= 0 && a[axis + 2] <= self.size_px[axis];
        fits(0) && fits(1) && !self.taken.iter().any(covers)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn captions(boxes: &[[i64; 4]]) -> Captions {
        Captions::among(boxes.to_vec(), [400, 400])
    }

    #[test]
    fn a_text_stays_in_the_picture_and_off_other_boxes() {
        let mut narrow = captions(&[[34, 90, 80, 130]]);
        let [x, y] = narrow.place([8, 100, 30, 110], [59, 7]);
        assert!(x >= 0 && y >= 0, "{x} {y}");
        assert_eq!(narrow.place([380, 395, 399, 399], [60, 7])[0], 316);
        let mut beside = captions(&[[130, 40, 300, 70]]);
        assert_eq!(beside.place([100, 50, 120, 90], [60, 7]), [124, 75]);
    }

    #[test]
    fn texts_of_boxes_in_one_place_stand_apart_while_there_is_room() {
        let mut few = captions(&[]);
        let places = [0; 3].map(|_| few.place([100, 50, 120, 90], [60, 7]));
        assert_eq!(places[0], [124, 48]);
        for (i, a) in places.iter().enumerate() {
            for b in &places[..i] {
                assert!((a[1] - b[1]).abs() >= 7 || (a[0] - b[0]).abs() >= 60);
            }
        }
        let mut many = captions(&[]);
        let places = [0; 101].map(|_| many.place([0, 0, 10, 10], [60, 7]));
        let last = places[100];
        assert_eq!(last, [14, 0], "where all is taken the text is there too");
    }
}
