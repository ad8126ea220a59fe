//! Targets of each anchor and each cell of a frame.
//!
//! Anchors: the public SECOND assignment. Only objects of an anchor's own class count; the overlap is that of the "nearest" axis-aligned footprints,
//! without heights. An anchor is positive at or above its class's matched overlap, negative below the unmatched one, else ignored; each object's best
//! anchors are positive at any overlap. Cells (for the metric loss, paper section 3.2, eq. 2): cells with their centre in a footprint (the smallest
//! wins), the cell of each object's centre, and cells of positive anchors. Synthetic unknown objects of no class are matched, like known objects, with the
//! class-agnostic anchors; without these, with the anchors of the class that overlaps them most. Anchors of a class that overlap them are ignored. Objects
//! that are not trained on (see [`crate::scan`]) make the anchors and cells under them ignored.

use crate::{anchors::Anchors, scan::LabelledObject};
use mluc_geometry::Box3;
use mluc_head::decode::{direction_bin, encode};
use std::{collections::BTreeMap, collections::BTreeSet, ops::Range};

/// Anchors this close to an ignored footprint are ignored.
const IGNORE_MARGIN_M: f64 = 0.3;

/// An anchor that has to detect an object.
#[derive(Clone, Debug, PartialEq)]
pub struct Positive {
    /// Index of the cell, y * columns + x.
    pub cell: u32,
    /// Index in the cell, class * 2 + rotation.
    pub anchor: u32,
    /// Box residuals.
    pub codes: [f32; 7],
    /// Direction bin.
    pub bin: u8,
}

/// Content of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CellClass {
    /// An object of this class.
    Known(u32),
    /// A synthetic unknown object, of no class.
    Unknown,
    /// No object.
    Background,
}

/// A cell of the metric loss.
#[derive(Clone, Debug, PartialEq)]
pub struct CellLabel {
    /// Index of the cell, y * columns + x.
    pub cell: u32,
    /// Content of the cell.
    pub is: CellClass,
    /// Weight; the sum over a frame with objects is 1, without background.
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

/// The best overlap of an anchor, its object, and whether the anchor is an object's best one.
#[derive(Clone, Copy)]
struct Best {
    iou: f64,
    object: usize,
    is_forced: bool,
}

impl Anchors {
    /// Targets of a frame.
    pub fn assign(&self, objects: &[LabelledObject]) -> Targets {
        let mut found = Targets { ignored: self.ignored_by_objects(objects), ..Targets::default() };
        // Cell and object of each positive anchor.
        let mut owners = vec![];
        for group in self.groups() {
            self.assign_group(group, objects, &mut found, &mut owners);
        }
        let positives = found.positives.iter();
        let positive: BTreeSet<u32> = positives.map(|p| self.number(p.cell, p.anchor)).collect();
        found.ignored.retain(|a| !positive.contains(a));
        found.ignored.sort_unstable();
        found.ignored.dedup();
        found.cells = self.label_cells(objects, &owners);
        found
    }

    /// Index of an anchor in the map.
    fn number(&self, cell: u32, anchor: u32) -> u32 {
        cell * self.per_cell() as u32 + anchor
    }

    fn unmatched(&self, anchor: usize) -> f64 {
        f64::from(self.classes[anchor / 2].unmatched_iou)
    }

    /// Indices of the anchors `anchor` whose overlap with `object` is too large for a negative.
    fn near(&self, object: &Box3, anchor: usize) -> impl Iterator<Item = u32> {
        let unmatched = self.unmatched(anchor);
        let near = self.overlaps(object, anchor).into_iter();
        let near = near.filter(move |(_, iou)| *iou >= unmatched);
        near.map(move |(cell, _)| self.number(cell, anchor as u32))
    }

    fn ignored_by_objects(&self, objects: &[LabelledObject]) -> Vec<u32> {
        let mut ignored = vec![];
        for object in objects.iter().filter(|o| !o.is_trained()) {
            for cell in self.cells_under(&object.bounds, IGNORE_MARGIN_M) {
                ignored.extend(self.number(cell, 0)..self.number(cell + 1, 0));
            }
            if let Some(class) = object.class {
                ignored.extend(self.near(&object.bounds, 2 * class));
                ignored.extend(self.near(&object.bounds, 2 * class + 1));
            }
        }
        ignored
    }

    fn has_agnostic(&self) -> bool {
        self.classes.len() > self.known
    }

    /// Groups of anchors that are matched with an object: one group for each class, and one for all class-agnostic anchors.
    fn groups(&self) -> Vec<Range<usize>> {
        let mut groups: Vec<Range<usize>> = (0..self.known).map(|class| class..class + 1).collect();
        if self.has_agnostic() {
            groups.push(self.known..self.classes.len());
        }
        groups
    }

    /// The group whose anchors have to detect a synthetic unknown object: the class-agnostic ones, else the group with the largest overlap.
    fn group_of_unknown(&self, object: &LabelledObject) -> usize {
        if self.has_agnostic() {
            return self.known;
        }
        let best = |class: usize| {
            let pairs = [0, 1].map(|r| self.overlaps(&object.bounds, 2 * class + r));
            pairs.iter().flatten().map(|(_, iou)| *iou).fold(0.0, f64::max)
        };
        let bests: Vec<f64> = (0..self.known).map(best).collect();
        (0..self.known).fold(0, |a, b| if bests[b] > bests[a] { b } else { a })
    }

    /// Positives and ignored anchors of one group.
    fn assign_group(
        &self,
        group: Range<usize>,
        objects: &[LabelledObject],
        found: &mut Targets,
        owners: &mut Vec<(u32, usize)>,
    ) {
        let mut best: BTreeMap<(u32, usize), Best> = BTreeMap::new();
        let anchors = 2 * group.start..2 * group.end;
        for (number, object) in objects.iter().enumerate().filter(|(_, o)| o.is_trained()) {
            let class = object.trained_class();
            let is_target = match class {
                Some(class) => group.contains(&class) || group.start == self.known,
                None => group.start == self.group_of_unknown(object),
            };
            if !is_target {
                // Ignored: an object of no class may resemble one of the class of these anchors.
                if class.is_none() {
                    let near = anchors.clone();
                    let near = near.map(|anchor| self.near(&object.bounds, anchor));
                    found.ignored.extend(near.flatten());
                }
                continue;
            }
            let overlaps = |anchor: usize| {
                let near = self.overlaps(&object.bounds, anchor).into_iter();
                near.map(move |(cell, iou)| ((cell, anchor), iou))
            };
            let pairs: Vec<_> = anchors.clone().flat_map(overlaps).collect();
            let most = pairs.iter().map(|(_, iou)| *iou).fold(0.0, f64::max);
            for (key, iou) in pairs {
                let entry =
                    best.entry(key).or_insert(Best { iou: 0.0, object: number, is_forced: false });
                if iou > entry.iou {
                    (entry.iou, entry.object) = (iou, number);
                }
                entry.is_forced |= iou == most;
            }
        }
        for ((cell, anchor), best) in best {
            let matched = f64::from(self.classes[anchor / 2].matched_iou);
            if best.is_forced || best.iou >= matched {
                let object = &objects[best.object].bounds;
                let codes = encode(object, &self.boxes.anchor(cell as usize, anchor));
                found.positives.push(Positive {
                    cell,
                    anchor: anchor as u32,
                    codes: codes.map(|c| c as f32),
                    bin: direction_bin(object.yaw_rad) as u8,
                });
                owners.push((cell, best.object));
            } else if best.iou >= self.unmatched(anchor) {
                found.ignored.push(self.number(cell, anchor as u32));
            }
        }
    }

    fn label_cells(&self, objects: &[LabelledObject], owners: &[(u32, usize)]) -> Vec<CellLabel> {
        let trained = (0..objects.len()).filter(|i| objects[*i].is_trained());
        let mut trained: Vec<usize> = trained.collect();
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
        // The last index counts synthetic unknown objects, which are a class of their own here.
        let place = |number: usize| objects[number].class.unwrap_or(self.known);
        let mut objects_of = vec![0usize; self.known + 1];
        let with_cells = (0..objects.len()).filter(|number| cells_of[*number] > 0);
        with_cells.for_each(|number| objects_of[place(number)] += 1);
        let present = objects_of.iter().filter(|n| **n > 0).count();
        let label = |(cell, number): (u32, usize)| {
            let share = present * objects_of[place(number)] * cells_of[number];
            let known = |class: usize| CellClass::Known(class as u32);
            CellLabel {
                cell,
                is: objects[number].class.map_or(CellClass::Unknown, known),
                weight: 1.0 / share as f32,
            }
        };
        owner.into_iter().map(label).collect()
    }
}

#[cfg(test)]
#[path = "targets_tests.rs"]
mod tests;
