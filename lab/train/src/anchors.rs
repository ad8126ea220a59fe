//! Positions of the anchors and cells of a map, and their overlaps with objects.

use mluc_geometry::{Box3, limit_period};
use mluc_head::decode::{self, ANCHOR_YAWS_RAD};
use mluc_model::{AnchorClass, Manifest};

/// The anchors of a map and their positions.
#[derive(Clone, Debug)]
pub struct Anchors {
    /// Boxes of the anchors.
    pub(crate) boxes: decode::Anchors,
    pub(crate) rows: usize,
    pub(crate) columns: usize,
    /// Edge lengths of a cell.
    cell_m: [f64; 2],
    /// Known classes, then the class-agnostic sizes.
    pub(crate) classes: Vec<AnchorClass>,
    /// Number of known classes in `classes`.
    pub(crate) known: usize,
}

impl Anchors {
    /// The anchors of a manifest.
    pub fn of(manifest: &Manifest) -> Anchors {
        let [rows, columns] = manifest.network.map_shape();
        let grid = &manifest.network.grid;
        let span = |i: usize| f64::from(grid.range_max_m[i]) - f64::from(grid.range_min_m[i]);
        Anchors {
            boxes: decode::Anchors::new(manifest),
            rows,
            columns,
            cell_m: [span(0) / columns as f64, span(1) / rows as f64],
            classes: [&manifest.classes[..], &manifest.generic].concat(),
            known: manifest.classes.len(),
        }
    }

    /// Number of anchors per cell.
    pub fn per_cell(&self) -> usize {
        self.boxes.per_cell()
    }

    /// The cell that contains a position.
    pub(crate) fn cell_at(&self, x_m: f64, y_m: f64) -> Option<u32> {
        let column = ((x_m - self.boxes.origin_m[0]) / self.cell_m[0]).floor();
        let row = ((y_m - self.boxes.origin_m[1]) / self.cell_m[1]).floor();
        let inside =
            column >= 0.0 && row >= 0.0 && column < self.columns as f64 && row < self.rows as f64;
        inside.then(|| (row as usize * self.columns + column as usize) as u32)
    }

    /// Cells whose centre is in the footprint of `bounds`, grown by `margin_m`.
    pub(crate) fn cells_under(&self, bounds: &Box3, margin_m: f64) -> Vec<u32> {
        let [length, width] = [0, 1].map(|i| bounds.size_m[i] + 2.0 * margin_m);
        let grown = Box3 { size_m: [length, width, 1.0], ..*bounds };
        let radius = length.hypot(width) / 2.0;
        let range = |axis: usize, limit: usize| {
            let at = (bounds.center_m[axis] - self.boxes.origin_m[axis]) / self.cell_m[axis];
            let reach = radius / self.cell_m[axis];
            let clamp = |v: f64| v.clamp(0.0, limit as f64) as usize;
            clamp((at - reach).floor())..clamp((at + reach).ceil())
        };
        let mut cells = vec![];
        for row in range(1, self.rows) {
            for column in range(0, self.columns) {
                let x = self.boxes.origin_m[0] + (column as f64 + 0.5) * self.cell_m[0];
                let y = self.boxes.origin_m[1] + (row as f64 + 0.5) * self.cell_m[1];
                if grown.contains([x, y, bounds.center_m[2]]) {
                    cells.push((row * self.columns + column) as u32);
                }
            }
        }
        cells
    }

    /// The cell of every anchor of index `anchor` that overlaps `object`, with the overlap of their nearest axis-aligned footprints.
    pub(crate) fn overlaps(&self, object: &Box3, anchor: usize) -> Vec<(u32, f64)> {
        let size = self.classes[anchor / 2].size_m.map(f64::from);
        let [ax, ay] = nearest(size, ANCHOR_YAWS_RAD[anchor % 2]);
        let [gx, gy] = nearest(object.size_m, object.yaw_rad);
        let shared = |axis: usize, limit: usize, a: f64, g: f64| -> Vec<(usize, f64)> {
            let at = object.center_m[axis] - self.boxes.origin_m[axis];
            let step = self.boxes.step_m[axis];
            let reach = (a + g) / 2.0;
            let first = ((at - reach) / step).floor().clamp(0.0, limit as f64) as usize;
            let end = ((at + reach) / step).ceil().clamp(-1.0, limit as f64 - 1.0) as isize + 1;
            let overlap = |i: usize| (reach - (i as f64 * step - at).abs()).min(a).min(g);
            let found = (first..end.max(0) as usize).map(|i| (i, overlap(i)));
            found.filter(|(_, overlap)| *overlap > 0.0).collect()
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
}

/// Extent of the axis-aligned footprint that is nearest to a rotated one.
pub(crate) fn nearest([length, width, _]: [f64; 3], yaw_rad: f64) -> [f64; 2] {
    let turn = limit_period(yaw_rad, 0.5, std::f64::consts::PI);
    if turn.abs() < std::f64::consts::FRAC_PI_4 { [length, width] } else { [width, length] }
}
