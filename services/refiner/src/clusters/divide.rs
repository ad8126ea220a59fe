//! From cells to clusters: unites cells that belong together, and divides components that are too large.
//!
//! A component is divided in this order. Parts that stand upright by themselves at half the join distance (people side by side) become clusters.
//! A rest larger than a road user is united again with a shorter join distance, up to a number of times. If it is still longer than any road user,
//! it is cut across its length into equal pieces. Only clusters with too few points are dropped.

use super::cells::Cells;
use crate::size::{is_upright, is_whole, is_within, longest_side, whole_diagonal_m};
use crate::{Settings, fit::ClusterPoints, priors};
use std::ops::Range;

/// Maximum extent of an upright part along x or y, m: an upright part is at most 4.5 m high, and shorter than high.
const UPRIGHT_LENGTH_MAX_M: f32 = 3.5;
/// Factor on the join distance for parts that stand upright by themselves: the full distance would join people side by side.
const UPRIGHT_SCALE: f64 = 0.5;
/// A rest counts if it has at least one point for this many points that stand upright.
const REST_ONE_IN: usize = 3;
/// Factor on the join distance of each further attempt to divide a piece that is too large.
const SHRINK_FACTOR: f64 = 0.6;
/// Number of these attempts.
const SHRINK_ATTEMPTS: u32 = 2;

/// Cells that belong together.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Piece {
    first: u32,
    end: u32,
    /// How often its join distance was shortened.
    attempts: u32,
    /// Longest side of the component that it was divided from, m.
    pub(super) component_length_m: f32,
    /// Whether it was cut to the maximum length.
    pub(super) is_cut: bool,
    /// Sort keys of the clusters, once all are found: points, then lowest x, y and highest x, y, m.
    points: u32,
    extent_m: [f32; 4],
}

impl Piece {
    fn range(&self) -> Range<usize> {
        self.first as usize..self.end as usize
    }

    /// The same piece with other cells.
    fn with(self, first: u32, end: u32) -> Piece {
        Piece { first, end, ..self }
    }
}

/// Divides the components of each frame; buffers are reused.
#[derive(Debug, Default)]
pub(super) struct Divider {
    pub(super) settings: Settings,
    /// Number of cells before any was added. Parts without any of these cells were not requested, and are not divided further.
    first_added: u32,
    /// Cells of all pieces, by their ranges.
    order: Vec<u32>,
    pending: Vec<Piece>,
    done: Vec<Piece>,
    cluster: ClusterPoints,
    scratch: Vec<u32>,
    /// Parts, and whether they stand upright.
    uprights: Vec<(Piece, bool)>,
}

impl Divider {
    pub(super) fn new(settings: &Settings) -> Divider {
        Divider { settings: settings.clone(), ..Divider::default() }
    }

    /// The pieces of the last frame, pieces with most points first.
    pub(super) fn pieces(&self) -> &[Piece] {
        &self.done
    }

    pub(super) fn cells_of(&self, piece: &Piece) -> &[u32] {
        &self.order[piece.range()]
    }

    /// Divides the components that contain any of the cells; `add` adds a tile that a component comes near.
    pub(super) fn divide(&mut self, cells: &mut Cells, add: impl FnMut(&mut Cells, usize)) {
        self.pending.clear();
        self.done.clear();
        self.first_added = cells.cells.len() as u32;
        cells.unite_whole(|range_m| self.join_m(range_m, 1.0), add);
        self.order.clear();
        self.order.extend_from_slice(&cells.reached);
        self.push_parts(cells, Piece::default());
        for piece in &mut self.pending {
            piece.component_length_m = cells.length_m(&self.order[piece.range()]);
        }
        while let Some(piece) = self.pending.pop() {
            self.settle(cells, piece);
        }
        self.rank(cells);
    }

    /// The join distance at a range times a factor, m.
    fn join_m(&self, range_m: f32, scale: f64) -> f32 {
        let s = &self.settings;
        let full_m = (s.join_m + s.join_per_range * f64::from(range_m)).min(s.join_max_m);
        (full_m * scale) as f32
    }

    /// Sorts the pieces; those with too few points are dropped.
    fn rank(&mut self, cells: &mut Cells) {
        for piece in &mut self.done {
            let own = &self.order[piece.range()];
            piece.points = cells.count(own) as u32;
            piece.extent_m = cells.extent_m(own);
        }
        // The rests of upright parts, and the slices of a cut, are counted here for the first time.
        let points_min = self.settings.points_min;
        self.done.retain(|piece| piece.points >= points_min);
        self.done.sort_unstable_by(|a, b| {
            let by_place = a.extent_m.partial_cmp(&b.extent_m).unwrap_or(std::cmp::Ordering::Equal);
            b.points.cmp(&a.points).then(by_place)
        });
    }

    /// Processes one piece: it is done, dropped, or divided further.
    fn settle(&mut self, cells: &mut Cells, mut piece: Piece) {
        let own = self.cells_of(&piece);
        let is_far = own.iter().all(|&cell| cell >= self.first_added);
        if is_far || cells.count(own) < self.settings.points_min as usize {
            return;
        }
        let mut is_short = self.collect_short(cells, &piece);
        if is_short && is_upright(&self.cluster) {
            self.done.push(piece);
            return;
        }
        if piece.attempts == 0 {
            let is_small = is_short && is_within(&self.cluster, priors::UPRIGHT_APART_M);
            piece = self.take_upright_parts(cells, piece, is_small);
            if piece.first == piece.end {
                return;
            }
            is_short = self.collect_short(cells, &piece);
        }
        if is_short && is_whole(&self.cluster) {
            self.done.push(piece);
        } else if piece.attempts < SHRINK_ATTEMPTS {
            piece.attempts += 1;
            self.split(cells, piece, SHRINK_FACTOR.powi(piece.attempts as i32));
        } else {
            self.collect(cells, &piece);
            self.cut(cells, piece);
        }
    }

    /// Collects a piece unless it is longer along x or y than the diagonal of any road user; returns whether it is collected.
    fn collect_short(&mut self, cells: &Cells, piece: &Piece) -> bool {
        let is_short = f64::from(cells.length_m(self.cells_of(piece))) <= whole_diagonal_m();
        if is_short {
            self.collect(cells, piece);
        }
        is_short
    }

    /// Divides a piece by a shorter join distance; the parts become pending.
    fn split(&mut self, cells: &mut Cells, piece: Piece, scale: f64) {
        cells.unite(self.cells_of(&piece), |range_m| self.join_m(range_m, scale));
        self.order[piece.range()].copy_from_slice(&cells.reached);
        self.push_parts(cells, piece);
    }

    /// Adds the components that were united last as pending pieces, from the first cell of `piece` on.
    fn push_parts(&mut self, cells: &Cells, piece: Piece) {
        let mut first = piece.first;
        for end in cells.ends.iter().map(|end| piece.first + end) {
            self.pending.push(piece.with(first, end));
            first = end;
        }
    }

    /// Parts that stand upright are done; the rest stays one piece. A small piece is only divided if its rest does not count.
    fn take_upright_parts(&mut self, cells: &mut Cells, piece: Piece, is_small: bool) -> Piece {
        let before = self.pending.len();
        self.split(cells, piece, UPRIGHT_SCALE);
        if self.pending.len() == before + 1 {
            self.pending.truncate(before);
            return piece;
        }
        self.uprights.clear();
        let mut points = [0, 0];
        for at in before..self.pending.len() {
            let part = self.pending[at];
            let upright = self.stands_upright(cells, &part);
            let count = cells.count(self.cells_of(&part));
            if count >= self.settings.points_min as usize {
                points[usize::from(upright)] += count;
            }
            self.uprights.push((part, upright));
        }
        self.pending.truncate(before);
        // The body of a forklift next to its mast is a rest that counts; the kerb next to a person is not.
        let [rest, upright] = points;
        let takes = !is_small || rest * REST_ONE_IN < upright.max(1);
        self.scratch.clear();
        let mut upright_end = piece.first;
        for &(part, upright) in &self.uprights {
            if upright && takes {
                // Upright parts move to the front, over cells that are already processed.
                self.order.copy_within(part.range(), upright_end as usize);
                let first = upright_end;
                upright_end += part.end - part.first;
                self.done.push(part.with(first, upright_end));
            } else {
                self.scratch.extend_from_slice(&self.order[part.range()]);
            }
        }
        let mut rest = piece;
        rest.first = upright_end;
        self.order[rest.range()].copy_from_slice(&self.scratch);
        rest
    }

    /// Whether a part is a separate object that stands upright.
    fn stands_upright(&mut self, cells: &Cells, part: &Piece) -> bool {
        let own = self.cells_of(part);
        // No person is as wide as a car: most parts of walls need no closer check.
        let is_sparse = cells.count(own) < self.settings.points_min as usize;
        if is_sparse || cells.length_m(own) > UPRIGHT_LENGTH_MAX_M {
            return false;
        }
        self.collect(cells, part);
        is_upright(&self.cluster)
    }

    /// Cuts a piece that is longer than any road user across its length, by the middles of its cells.
    fn cut(&mut self, cells: &Cells, piece: Piece) {
        let (yaw_rad, length_m) = longest_side(&self.cluster);
        let count = (length_m / priors::LENGTH_MAX_M).ceil().max(1.0);
        let (sin, cos) = (yaw_rad.sin() as f32, yaw_rad.cos() as f32);
        let along = |cell: u32| {
            let [x0, y0, x1, y1] = cells.cells[cell as usize].extent_m;
            (x0 + x1) / 2.0 * cos + (y0 + y1) / 2.0 * sin
        };
        let own = &mut self.order[piece.range()];
        let low = own.iter().map(|&c| along(c)).fold(f32::INFINITY, f32::min);
        let slice_m = (length_m / count) as f32;
        let slice = |cell: u32| (((along(cell) - low) / slice_m) as u32).min(count as u32 - 1);
        own.sort_unstable_by_key(|&cell| (slice(cell), cell));
        let mut first = piece.first;
        while first < piece.end {
            let here = slice(self.order[first as usize]);
            let own = &self.order[first as usize..piece.end as usize];
            let end = first + own.partition_point(|&cell| slice(cell) == here) as u32;
            self.done.push(Piece { is_cut: count > 1.0, ..piece.with(first, end) });
            first = end;
        }
    }

    /// Collects the points of a piece seen from above, and its lowest and highest z: enough to check its size.
    fn collect(&mut self, cells: &Cells, piece: &Piece) {
        self.cluster.clear();
        for &cell in &self.order[piece.range()] {
            let [low, high] = cells.cells[cell as usize].z_m;
            for (i, slot) in cells.points(cell).enumerate() {
                let [x, y] = cells.places_m[slot];
                self.cluster.push(x, y, if i == 0 { low } else { high });
            }
        }
    }
}
