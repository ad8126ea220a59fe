//! From cells to clusters: what belongs together, and how what is too large is divided.
//!
//! A component is taken apart in this order: parts that stand upright by themselves at half the reach (people beside each
//! other) become clusters; what is then larger than a road user is grown again with a shorter reach, up to a number of
//! times; what is longer than any road user even so is cut across its length into equal pieces. Nothing is dropped but
//! clusters with too few points, and those are counted.

use super::cells::Cells;
use crate::PRIORS;
use crate::fit::ClusterPoints;
use crate::size::{is_rest, is_upright, is_within, longest_side};

/// What stands upright is at most 4.5 m high, and shorter than high: so much at most along x or y, m.
const UPRIGHT_LENGTH_MAX_M: f32 = 3.5;

/// Factor on the join distance for parts that stand upright by themselves: people beside each other are joined otherwise.
const UPRIGHT_SCALE: f64 = 0.5;
/// Factor on the join distance of each further attempt at what is too large,
const SHRINK_FACTOR: f64 = 0.6;
/// and their number.
const SHRINK_ATTEMPTS: u32 = 2;

/// Clusters of one frame at most; those with the fewest points are dropped first, and counted.
const CLUSTERS_MAX: usize = 4096;

/// Where the points of a frame went.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FrameCounters {
    /// Points with NaN or infinity.
    pub points_not_finite: u32,
    /// Points beyond 128 m, or beyond the contract's limit.
    pub points_outside: u32,
    /// Points of the ground.
    pub points_ground: u32,
    /// Points that hang higher than any road user is.
    pub points_above: u32,
    /// Points that a known object owns.
    pub points_known: u32,
    /// Points of clusters with too few of them.
    pub points_too_few: u32,
    /// Components at the full reach, before anything was divided.
    pub components: u32,
    /// Clusters with too few points.
    pub clusters_too_small: u32,
    /// Clusters longer than any road user, cut to size.
    pub oversized: u32,
    /// Clusters beyond the limit of 4096.
    pub clusters_dropped: u32,
}

/// A piece with what orders clusters: points, then place.
#[derive(Clone, Copy, Debug)]
pub(super) struct RankedPiece {
    pub(super) points: u32,
    /// Lowest x, y and highest x, y, m.
    pub(super) extent_m: [f32; 4],
    pub(super) piece: Piece,
}

/// Some cells that belong together.
#[derive(Clone, Copy, Debug)]
pub(super) struct Piece {
    first: u32,
    end: u32,
    /// How often its reach was shortened.
    attempts: u32,
    /// Longest side of the component that it is from, m.
    pub(super) component_length_m: f32,
    /// Whether it was cut to size.
    pub(super) is_cut: bool,
}

/// Divides frame after frame; buffers are reused.
#[derive(Debug)]
pub(super) struct Divider {
    points_min: usize,
    /// Cells of all pieces, by their ranges; ascending within each until it is cut.
    order: Vec<u32>,
    pending: Vec<Piece>,
    done: Vec<Piece>,
    ranked: Vec<RankedPiece>,
    cluster: ClusterPoints,
    scratch: Vec<u32>,
    /// Parts, and whether they stand upright.
    uprights: Vec<(Piece, bool)>,
    part_of_root: Vec<u32>,
    part_first: Vec<u32>,
}

impl Divider {
    pub(super) fn new(points_min: usize) -> Divider {
        Divider {
            points_min,
            order: Vec::new(),
            pending: Vec::new(),
            done: Vec::new(),
            ranked: Vec::with_capacity(CLUSTERS_MAX),
            cluster: ClusterPoints::default(),
            scratch: Vec::new(),
            uprights: Vec::new(),
            part_of_root: Vec::new(),
            part_first: Vec::new(),
        }
    }

    /// The pieces of the last frame, those with most points first.
    pub(super) fn pieces(&self) -> &[RankedPiece] {
        &self.ranked
    }

    /// Cells of a piece.
    pub(super) fn cells_of(&self, piece: &Piece) -> &[u32] {
        &self.order[piece.first as usize..piece.end as usize]
    }

    /// Divides all cells; `join_m` gives the full join distance at a range.
    pub(super) fn divide(
        &mut self,
        cells: &mut Cells,
        join_m: impl Fn(f64) -> f64,
        counters: &mut FrameCounters,
    ) {
        let count = cells.cells.len() as u32;
        self.order.clear();
        self.order.extend(0..count);
        self.pending.clear();
        self.done.clear();
        let all = Piece {
            first: 0,
            end: count,
            attempts: 0,
            component_length_m: 0.0,
            is_cut: false,
        };
        self.split(cells, all, 1.0, &join_m);
        for piece in &mut self.pending {
            let own = &self.order[piece.first as usize..piece.end as usize];
            let [x0, y0, x1, y1] = cells.extent_m(own);
            piece.component_length_m = (x1 - x0).max(y1 - y0);
        }
        counters.components = self.pending.len() as u32;
        while let Some(piece) = self.pending.pop() {
            self.settle(cells, piece, &join_m, counters);
        }
        counters.clusters_dropped = self.rank(cells) as u32;
    }

    /// Sorts the pieces; how many were too many.
    fn rank(&mut self, cells: &Cells) -> usize {
        self.ranked.clear();
        self.ranked.extend(self.done.iter().map(|piece| {
            let own = &self.order[piece.first as usize..piece.end as usize];
            RankedPiece {
                points: cells.count(own) as u32,
                extent_m: cells.extent_m(own),
                piece: *piece,
            }
        }));
        self.ranked.sort_unstable_by(|a, b| {
            let places = || a.extent_m.partial_cmp(&b.extent_m);
            b.points
                .cmp(&a.points)
                .then_with(|| places().unwrap_or(std::cmp::Ordering::Equal))
        });
        let dropped = self.ranked.len().saturating_sub(CLUSTERS_MAX);
        self.ranked.truncate(CLUSTERS_MAX);
        dropped
    }

    /// One piece: done, dropped, or divided further.
    fn settle(
        &mut self,
        cells: &mut Cells,
        mut piece: Piece,
        join_m: &impl Fn(f64) -> f64,
        counters: &mut FrameCounters,
    ) {
        let points = cells.count(self.cells_of(&piece));
        if points < self.points_min {
            counters.clusters_too_small += 1;
            counters.points_too_few += points as u32;
            return;
        }
        // Longer than the diagonal of any road user along x or y: no need to look at its points.
        let [x0, y0, x1, y1] = cells.extent_m(self.cells_of(&piece));
        let diagonal_m = PRIORS.whole.diagonal_m();
        let is_large = |length_m: f32| f64::from(length_m) > diagonal_m;
        let mut large = is_large((x1 - x0).max(y1 - y0));
        let mut is_small = false;
        if !large {
            self.collect(cells, &piece);
            if is_upright(&self.cluster) {
                self.done.push(piece);
                return;
            }
            is_small = is_within(&self.cluster, PRIORS.upright_apart_m);
        }
        if piece.attempts == 0 {
            let whole = piece;
            piece = self.take_upright_parts(cells, piece, is_small, join_m);
            if piece.first == piece.end {
                return;
            }
            if piece.first != whole.first {
                let [x0, y0, x1, y1] = cells.extent_m(self.cells_of(&piece));
                large = is_large((x1 - x0).max(y1 - y0));
            }
            if !large {
                self.collect(cells, &piece);
            }
        }
        if !large && PRIORS.whole.hold(&self.cluster) {
            self.done.push(piece);
        } else if piece.attempts < SHRINK_ATTEMPTS {
            piece.attempts += 1;
            let scale = SHRINK_FACTOR.powi(piece.attempts as i32);
            self.split(cells, piece, scale, join_m);
        } else {
            self.collect(cells, &piece);
            counters.oversized += u32::from(self.cut(cells, piece));
        }
    }

    /// Divides a piece by a shorter reach; the parts are pending.
    fn split(&mut self, cells: &mut Cells, piece: Piece, scale: f64, join_m: &impl Fn(f64) -> f64) {
        let own = &self.order[piece.first as usize..piece.end as usize];
        cells.unite(own, |range_m| (join_m(f64::from(range_m)) * scale) as f32);
        self.sort_into_parts(cells, piece);
    }

    /// Parts that stand upright are done; what is left stays one piece. A small piece is taken apart when no part of it
    /// does anything else.
    fn take_upright_parts(
        &mut self,
        cells: &mut Cells,
        piece: Piece,
        is_small: bool,
        join_m: &impl Fn(f64) -> f64,
    ) -> Piece {
        let before = self.pending.len();
        self.split(cells, piece, UPRIGHT_SCALE, join_m);
        let parts = before..self.pending.len();
        if parts.len() == 1 {
            self.pending.truncate(before);
            return piece;
        }
        self.uprights.clear();
        let mut points = [0, 0];
        for at in parts {
            let part = self.pending[at];
            let upright = self.stands_upright(cells, &part);
            let count = cells.count(self.cells_of(&part));
            if count >= self.points_min {
                points[usize::from(upright)] += count;
            }
            self.uprights.push((part, upright));
        }
        self.pending.truncate(before);
        let takes = !(is_small && is_rest(points[0], points[1]));
        self.scratch.clear();
        let mut upright_end = piece.first as usize;
        for at in 0..self.uprights.len() {
            let (mut part, upright) = self.uprights[at];
            let range = part.first as usize..part.end as usize;
            if upright && takes {
                // Upright parts move to the front, which only cells already looked at leave.
                self.order.copy_within(range.clone(), upright_end);
                part.first = upright_end as u32;
                upright_end += range.len();
                part.end = upright_end as u32;
                self.done.push(part);
            } else {
                self.scratch.extend_from_slice(&self.order[range]);
            }
        }
        // Ascending again, as a sweep over them wants it.
        self.scratch.sort_unstable();
        self.order[upright_end..piece.end as usize].copy_from_slice(&self.scratch);
        Piece {
            first: upright_end as u32,
            ..piece
        }
    }

    /// Whether a part is a thing of its own that stands upright.
    fn stands_upright(&mut self, cells: &Cells, part: &Piece) -> bool {
        let own = self.cells_of(part);
        let [x0, y0, x1, y1] = cells.extent_m(own);
        let enough = cells.count(own) >= self.points_min;
        // Nobody is as wide as a car: most parts of walls need no closer look.
        if !enough || (x1 - x0).max(y1 - y0) > UPRIGHT_LENGTH_MAX_M {
            return false;
        }
        self.collect(cells, part);
        is_upright(&self.cluster)
    }

    /// A piece's cells by what they are united with: each part becomes a pending piece.
    fn sort_into_parts(&mut self, cells: &mut Cells, piece: Piece) {
        const NO_PART: u32 = u32::MAX;
        let range = piece.first as usize..piece.end as usize;
        self.part_of_root.resize(cells.cells.len(), NO_PART);
        self.part_first.clear();
        for at in range.clone() {
            let root = cells.root(self.order[at]) as usize;
            if self.part_of_root[root] == NO_PART {
                self.part_of_root[root] = self.part_first.len() as u32;
                self.part_first.push(0);
            }
            self.part_first[self.part_of_root[root] as usize] += 1;
        }
        let mut first = piece.first;
        for count in &mut self.part_first {
            let part = Piece {
                first,
                end: first + *count,
                ..piece
            };
            self.pending.push(part);
            *count = first;
            first = part.end;
        }
        self.scratch.clear();
        self.scratch.extend_from_slice(&self.order[range]);
        for at in 0..self.scratch.len() {
            let cell = self.scratch[at];
            let part = self.part_of_root[cells.root(cell) as usize];
            let cursor = &mut self.part_first[part as usize];
            self.order[*cursor as usize] = cell;
            *cursor += 1;
        }
        for at in 0..self.scratch.len() {
            self.part_of_root[cells.root(self.scratch[at]) as usize] = NO_PART;
        }
    }

    /// Cuts what is longer than any road user across its length, by the middles of its cells. Whether there was need.
    fn cut(&mut self, cells: &Cells, piece: Piece) -> bool {
        let (yaw_rad, length_m) = longest_side(&self.cluster);
        let count = (length_m / PRIORS.length_max_m).ceil().max(1.0);
        let (sin, cos) = (yaw_rad.sin() as f32, yaw_rad.cos() as f32);
        let along = |cell: u32| {
            let [x0, y0, x1, y1] = cells.cells[cell as usize].extent_m;
            (x0 + x1) / 2.0 * cos + (y0 + y1) / 2.0 * sin
        };
        let own = &mut self.order[piece.first as usize..piece.end as usize];
        let low = own.iter().map(|&c| along(c)).fold(f32::INFINITY, f32::min);
        let slice_m = (length_m / count) as f32;
        let slice = |cell: u32| (((along(cell) - low) / slice_m) as u32).min(count as u32 - 1);
        own.sort_unstable_by_key(|&cell| (slice(cell), cell));
        let mut first = piece.first;
        while first < piece.end {
            let here = slice(self.order[first as usize]);
            let own = &self.order[first as usize..piece.end as usize];
            let end = first + own.partition_point(|&cell| slice(cell) == here) as u32;
            self.done.push(Piece {
                first,
                end,
                is_cut: count > 1.0,
                ..piece
            });
            first = end;
        }
        count > 1.0
    }

    /// The points of a piece seen from above, and its lowest and highest z: enough to judge its size.
    fn collect(&mut self, cells: &Cells, piece: &Piece) {
        self.cluster.clear();
        for &cell in &self.order[piece.first as usize..piece.end as usize] {
            let [low, high] = cells.cells[cell as usize].z_m;
            for (i, slot) in cells.points(cell).enumerate() {
                let [x, y] = cells.places_m[slot];
                self.cluster.push(x, y, if i == 0 { low } else { high });
            }
        }
    }
}
