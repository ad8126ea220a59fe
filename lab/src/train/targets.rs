//! What each anchor and each cell should say about a frame.
//!
//! Anchors: the public SECOND assignment. Only objects of an anchor's own class count; overlap is that of the "nearest"
//! axis-aligned footprints, heights ignored. An anchor is positive at or above its class's matched overlap, negative
//! below the unmatched one, ignored between; each object's best anchors are positive whatever their overlap.
//! Cells (for the metric loss, paper section 3.2, eq. 2): those whose centre lies in a footprint (the smallest wins),
//! the cell of each object's centre, and those of positive anchors.
//! Made-up objects of no class are matched with the anchors without a class, where the network has them, as known objects
//! are too; else with those of the class that overlaps them most. The anchors of a class that overlap them are ignored.
//! Objects that are not trained on (see [`super::scene`]) make anchors and cells under them ignored.

use std::collections::BTreeMap;
use std::ops::Range;

use mluc_geometry::{Box3, limit_period};
use mluc_model::{AnchorClass, Manifest, Network};

use super::scene::Object;

/// Yaw of a class's two anchors.
const ROTATIONS_RAD: [f64; 2] = [0.0, 1.57];
/// The direction bins are split at this angle and its opposite.
pub const DIRECTION_OFFSET_RAD: f64 = std::f64::consts::FRAC_PI_4;
/// Anchors this close to an ignored footprint are ignored.
const IGNORE_MARGIN_M: f64 = 0.3;

/// An anchor that should find an object.
#[derive(Clone, Debug, PartialEq)]
pub struct Positive {
    /// y * columns + x.
    pub cell: u32,
    /// class * 2 + rotation.
    pub anchor: u32,
    /// Box residuals.
    pub codes: [f32; 7],
    /// Direction bin.
    pub bin: u8,
}

/// What a cell holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CellClass {
    /// An object of this class.
    Known(u32),
    /// A made-up object of none.
    Unknown,
    /// No object.
    Background,
}

/// A cell of the metric loss.
#[derive(Clone, Debug, PartialEq)]
pub struct CellLabel {
    /// y * columns + x.
    pub cell: u32,
    /// What it holds.
    pub is: CellClass,
    /// Sums to 1 over a frame that has objects, background apart.
    pub weight: f32,
}

/// Labels of one frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Targets {
    /// Positive anchors.
    pub positives: Vec<Positive>,
    /// Anchors (cell * anchors + anchor) that are neither positive nor negative.
    pub ignored: Vec<u32>,
    /// Cells with a class.
    pub cells: Vec<CellLabel>,
}

/// Where the anchors stand.
#[derive(Clone, Debug)]
pub struct Anchors {
    rows: usize,
    columns: usize,
    min_m: [f64; 2],
    /// Spacing of anchors: both ends of the range carry one.
    step_m: [f64; 2],
    /// Edge of a cell.
    cell_m: [f64; 2],
    /// Known classes, then sizes without a class.
    classes: Vec<AnchorClass>,
    known: usize,
}

impl Anchors {
    /// For a network, its classes, and its anchors without a class.
    pub fn new(network: &Network, classes: &[AnchorClass], generic: &[AnchorClass]) -> Anchors {
        let [rows, columns] = network.map_shape();
        let (low, high) = (network.grid.range_min_m, network.grid.range_max_m);
        let span = [0, 1].map(|i| f64::from(high[i]) - f64::from(low[i]));
        Anchors {
            rows,
            columns,
            min_m: [f64::from(low[0]), f64::from(low[1])],
            step_m: [span[0] / (columns - 1) as f64, span[1] / (rows - 1) as f64],
            cell_m: [span[0] / columns as f64, span[1] / rows as f64],
            classes: [classes, generic].concat(),
            known: classes.len(),
        }
    }

    /// Of a manifest.
    pub fn of(manifest: &Manifest) -> Anchors {
        Anchors::new(&manifest.network, &manifest.classes, &manifest.generic)
    }

    /// Anchors of a cell.
    pub fn per_cell(&self) -> usize {
        2 * self.classes.len()
    }

    /// The anchor's box.
    pub fn bounds(&self, cell: usize, anchor: usize) -> Box3 {
        let class = &self.classes[anchor / 2];
        let size = class.size_m.map(f64::from);
        let x = self.min_m[0] + (cell % self.columns) as f64 * self.step_m[0];
        let y = self.min_m[1] + (cell / self.columns) as f64 * self.step_m[1];
        let z = f64::from(class.bottom_z_m) + size[2] / 2.0;
        Box3 {
            center_m: [x, y, z],
            size_m: size,
            yaw_rad: ROTATIONS_RAD[anchor % 2],
        }
    }

    /// The cell that holds a position.
    fn cell_at(&self, x_m: f64, y_m: f64) -> Option<u32> {
        let column = ((x_m - self.min_m[0]) / self.cell_m[0]).floor();
        let row = ((y_m - self.min_m[1]) / self.cell_m[1]).floor();
        let inside =
            column >= 0.0 && row >= 0.0 && column < self.columns as f64 && row < self.rows as f64;
        inside.then(|| (row as usize * self.columns + column as usize) as u32)
    }

    /// Cells whose centre lies in the footprint of `bounds`, grown by `margin_m`.
    fn cells_under(&self, bounds: &Box3, margin_m: f64) -> Vec<u32> {
        let grown = Box3 {
            size_m: [
                bounds.size_m[0] + 2.0 * margin_m,
                bounds.size_m[1] + 2.0 * margin_m,
                1.0,
            ],
            ..*bounds
        };
        let radius = grown.size_m[0].hypot(grown.size_m[1]) / 2.0;
        let range = |axis: usize, limit: usize| {
            let at = (bounds.center_m[axis] - self.min_m[axis]) / self.cell_m[axis];
            let reach = radius / self.cell_m[axis];
            let clamp = |v: f64| v.clamp(0.0, limit as f64) as usize;
            clamp((at - reach).floor())..clamp((at + reach).ceil())
        };
        let mut cells = vec![];
        for row in range(1, self.rows) {
            for column in range(0, self.columns) {
                let x = self.min_m[0] + (column as f64 + 0.5) * self.cell_m[0];
                let y = self.min_m[1] + (row as f64 + 0.5) * self.cell_m[1];
                if grown.contains([x, y, bounds.center_m[2]]) {
                    cells.push((row * self.columns + column) as u32);
                }
            }
        }
        cells
    }

    /// Every anchor of `anchor`'s kind that overlaps `object`, with the overlap of their nearest footprints.
    fn overlaps(&self, object: &Box3, anchor: usize) -> Vec<(u32, f64)> {
        let size = self.classes[anchor / 2].size_m.map(f64::from);
        let [ax, ay] = nearest(size, ROTATIONS_RAD[anchor % 2]);
        let [gx, gy] = nearest(object.size_m, object.yaw_rad);
        let shared = |axis: usize, limit: usize, a: f64, g: f64| -> Vec<(usize, f64)> {
            let (at, step) = (object.center_m[axis] - self.min_m[axis], self.step_m[axis]);
            let reach = (a + g) / 2.0;
            let first = ((at - reach) / step).floor().clamp(0.0, limit as f64) as usize;
            let end = ((at + reach) / step).ceil().clamp(-1.0, limit as f64 - 1.0) as isize + 1;
            (first..end.max(0) as usize)
                .map(|i| {
                    let distance = (i as f64 * step - at).abs();
                    (i, (reach - distance).min(a).min(g))
                })
                .filter(|(_, overlap)| *overlap > 0.0)
                .collect()
        };
        let columns = shared(0, self.columns, ax, gx);
        let mut found = vec![];
        for (row, dy) in shared(1, self.rows, ay, gy) {
            for (column, dx) in &columns {
                let both = dx * dy;
                let iou = both / (ax * ay + gx * gy - both);
                found.push(((row * self.columns + column) as u32, iou));
            }
        }
        found
    }

    /// Labels of a frame.
    pub fn assign(&self, objects: &[Object]) -> Targets {
        let mut targets = Targets::default();
        let mut owners: Vec<(u32, usize)> = vec![];
        let mut ignored = self.ignored_by_objects(objects);
        for group in self.groups() {
            self.assign_group(group, objects, &mut targets, &mut owners, &mut ignored);
        }
        let anchors = self.per_cell() as u32;
        let positive: std::collections::BTreeSet<u32> = targets
            .positives
            .iter()
            .map(|p| p.cell * anchors + p.anchor)
            .collect();
        ignored.retain(|a| !positive.contains(a));
        ignored.sort_unstable();
        ignored.dedup();
        targets.ignored = ignored;
        targets.cells = self.label_cells(objects, &owners);
        targets
    }

    fn ignored_by_objects(&self, objects: &[Object]) -> Vec<u32> {
        let anchors = self.per_cell() as u32;
        let mut ignored = vec![];
        for object in objects.iter().filter(|o| !o.is_trained()) {
            for cell in self.cells_under(&object.bounds, IGNORE_MARGIN_M) {
                ignored.extend(cell * anchors..(cell + 1) * anchors);
            }
            if let Some(class) = object.class {
                let unmatched = f64::from(self.classes[class].unmatched_iou);
                for anchor in [2 * class, 2 * class + 1] {
                    let near = self.overlaps(&object.bounds, anchor);
                    let near = near.iter().filter(|(_, iou)| *iou >= unmatched);
                    ignored.extend(near.map(|(cell, _)| cell * anchors + anchor as u32));
                }
            }
        }
        ignored
    }

    /// Anchors that one object is matched with: those of a class, and together those without one.
    fn groups(&self) -> Vec<Range<usize>> {
        let mut groups: Vec<Range<usize>> = (0..self.known).map(|class| class..class + 1).collect();
        if self.classes.len() > self.known {
            groups.push(self.known..self.classes.len());
        }
        groups
    }

    /// The group whose anchors a made-up object is to be found by: those without a class, else that of the largest overlap.
    fn group_of_unknown(&self, object: &Object) -> usize {
        if self.classes.len() > self.known {
            return self.known;
        }
        let best = |class: usize| {
            let pairs = [0, 1].map(|r| self.overlaps(&object.bounds, 2 * class + r));
            pairs
                .iter()
                .flatten()
                .map(|(_, iou)| *iou)
                .fold(0.0, f64::max)
        };
        let bests: Vec<f64> = (0..self.known).map(best).collect();
        (0..self.known).fold(0, |a, b| if bests[b] > bests[a] { b } else { a })
    }

    /// Positives and ignored anchors of one group; `owners` notes the cell and the object of each positive.
    fn assign_group(
        &self,
        group: Range<usize>,
        objects: &[Object],
        targets: &mut Targets,
        owners: &mut Vec<(u32, usize)>,
        ignored: &mut Vec<u32>,
    ) {
        // Anchor: best overlap, its object, forced.
        let mut best: BTreeMap<(u32, usize), (f64, usize, bool)> = BTreeMap::new();
        let anchors = self.per_cell();
        for (number, object) in objects.iter().enumerate().filter(|(_, o)| o.is_trained()) {
            let is_target = match object.trained_class() {
                Some(class) => group.contains(&class) || group.start == self.known,
                None => group.start == self.group_of_unknown(object),
            };
            if !is_target && object.trained_class().is_some() {
                continue;
            }
            let pairs: Vec<((u32, usize), f64)> = (2 * group.start..2 * group.end)
                .flat_map(|anchor| {
                    let near = self.overlaps(&object.bounds, anchor);
                    near.into_iter().map(move |(c, iou)| ((c, anchor), iou))
                })
                .collect();
            if !is_target {
                // Neither right nor wrong: an object of no class may look like one to the anchors of a class.
                let near = pairs
                    .into_iter()
                    .filter(|((_, a), iou)| *iou >= self.unmatched(*a));
                ignored.extend(near.map(|((c, a), _)| c * anchors as u32 + a as u32));
                continue;
            }
            let most = pairs.iter().map(|(_, iou)| *iou).fold(0.0, f64::max);
            for (key, iou) in pairs {
                let entry = best.entry(key).or_insert((0.0, number, false));
                if iou > entry.0 {
                    (entry.0, entry.1) = (iou, number);
                }
                entry.2 |= iou == most;
            }
        }
        for ((cell, anchor), (iou, object, forced)) in best {
            if forced || iou >= f64::from(self.classes[anchor / 2].matched_iou) {
                let positive = self.positive(cell, anchor, &objects[object].bounds);
                targets.positives.push(positive);
                owners.push((cell, object));
            } else if iou >= self.unmatched(anchor) {
                ignored.push(cell * anchors as u32 + anchor as u32);
            }
        }
    }

    fn unmatched(&self, anchor: usize) -> f64 {
        f64::from(self.classes[anchor / 2].unmatched_iou)
    }

    fn positive(&self, cell: u32, anchor: usize, object: &Box3) -> Positive {
        let a = self.bounds(cell as usize, anchor);
        let diagonal = a.size_m[0].hypot(a.size_m[1]);
        let d = [0, 1, 2].map(|i| object.center_m[i] - a.center_m[i]);
        let ratio = [0, 1, 2].map(|i| (object.size_m[i] / a.size_m[i]).ln());
        let turn = object.yaw_rad - a.yaw_rad;
        let codes = [
            d[0] / diagonal,
            d[1] / diagonal,
            d[2] / a.size_m[2],
            ratio[0],
            ratio[1],
            ratio[2],
            turn,
        ];
        let angle = limit_period(
            object.yaw_rad - DIRECTION_OFFSET_RAD,
            0.0,
            std::f64::consts::TAU,
        );
        let bin = (angle / std::f64::consts::PI).floor().clamp(0.0, 1.0) as u8;
        Positive {
            cell,
            anchor: anchor as u32,
            codes: codes.map(|c| c as f32),
            bin,
        }
    }

    fn label_cells(&self, objects: &[Object], owners: &[(u32, usize)]) -> Vec<CellLabel> {
        let mut trained: Vec<usize> = (0..objects.len())
            .filter(|i| objects[*i].is_trained())
            .collect();
        // Smallest footprint first, so that the first claim on a cell wins.
        let area = |i: &usize| objects[*i].bounds.size_m[0] * objects[*i].bounds.size_m[1];
        trained.sort_by(|a, b| area(a).total_cmp(&area(b)));
        let mut owner: BTreeMap<u32, usize> = BTreeMap::new();
        for &number in &trained {
            let bounds = &objects[number].bounds;
            let centre = self.cell_at(bounds.center_m[0], bounds.center_m[1]);
            for cell in self.cells_under(bounds, 0.0).into_iter().chain(centre) {
                owner.entry(cell).or_insert(number);
            }
        }
        for &(cell, number) in owners {
            owner.entry(cell).or_insert(number);
        }
        let mut cells_of = vec![0usize; objects.len()];
        owner.values().for_each(|number| cells_of[*number] += 1);
        // The last place counts made-up objects: a class of their own here.
        let place = |object: &Object| object.class.unwrap_or(self.known);
        let mut objects_of = vec![0usize; self.known + 1];
        let with_cells = objects
            .iter()
            .zip(&cells_of)
            .filter(|(_, cells)| **cells > 0);
        with_cells.for_each(|(object, _)| objects_of[place(object)] += 1);
        let present = objects_of.iter().filter(|n| **n > 0).count();
        let label = |(cell, number): (u32, usize)| {
            let object = &objects[number];
            let share = present * objects_of[place(object)] * cells_of[number];
            let known = |class: usize| CellClass::Known(class as u32);
            CellLabel {
                cell,
                is: object.class.map_or(CellClass::Unknown, known),
                weight: 1.0 / share as f32,
            }
        };
        owner.into_iter().map(label).collect()
    }
}

/// Extent of the axis-aligned footprint that is nearest to a turned one.
fn nearest(size_m: [f64; 3], yaw_rad: f64) -> [f64; 2] {
    let along =
        limit_period(yaw_rad, 0.5, std::f64::consts::PI).abs() < std::f64::consts::FRAC_PI_4;
    if along {
        [size_m[0], size_m[1]]
    } else {
        [size_m[1], size_m[0]]
    }
}

#[cfg(test)]
#[path = "targets_tests.rs"]
mod tests;
