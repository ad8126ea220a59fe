//! The batches of a run for a trainer on another machine: `tools/train_on_gpu`.
//!
//! The first line is JSON: the settings of the run. Then the frames follow, little-endian: number of voxels, of positive anchors,
//! of ignored anchors and of cells (u32 each); voxels (u16 z, y, x of each, then the f32 rows); positives (u32 cell, anchor and direction bin,
//! 7 f32 box codes); ignored anchors (u32 numbers in the map); cells (u32 cell, i32 class or -1 for unknown, f32 weight).

use crate::{settings::TrainSettings, targets::CellClass, targets::Targets};
use mluc_backbone::Voxels;

/// The settings that the other trainer needs.
pub(crate) fn header(settings: &TrainSettings) -> serde_json::Value {
    serde_json::json!({
        "steps": settings.steps, "batch": settings.batch, "rate_max": settings.learning_rate,
        "background_cells": settings.background_cells(), "losses": settings.losses(),
    })
}

/// Appends a frame.
pub(crate) fn write_frame(voxels: &Voxels, targets: &Targets, to: &mut Vec<u8>) {
    let sites = voxels.sites.coordinates();
    let (positives, ignored) = (&targets.positives, &targets.ignored);
    let lengths = [positives.len(), ignored.len(), targets.cells.len()];
    for count in [sites.len()].iter().chain(&lengths) {
        to.extend((*count as u32).to_le_bytes());
    }
    to.extend(sites.iter().flatten().flat_map(|at| at.to_le_bytes()));
    to.extend(voxels.rows.iter().flat_map(|value| value.to_le_bytes()));
    for p in positives {
        let places = [p.cell, p.anchor, p.bin.into()];
        to.extend(places.iter().flat_map(|place| place.to_le_bytes()));
        to.extend(p.codes.iter().flat_map(|code| code.to_le_bytes()));
    }
    to.extend(ignored.iter().flat_map(|anchor| anchor.to_le_bytes()));
    for label in &targets.cells {
        let class = match label.is {
            CellClass::Known(class) => class,
            CellClass::Unknown | CellClass::Background => u32::MAX,
        };
        let words = [label.cell, class, label.weight.to_bits()];
        to.extend(words.iter().flat_map(|word| word.to_le_bytes()));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::targets::{CellLabel, Positive};
    use mluc_backbone::voxelize;
    use mluc_model::Grid;

    #[test]
    fn a_frame_is_what_its_reader_expects() {
        let mut voxels = Voxels::new(&Grid::any());
        voxelize(&[[0.05, 0.05, 0.1, 0.5]], &Grid::any(), false, &mut voxels);
        let cells = [(7, CellClass::Known(2)), (8, CellClass::Unknown)];
        let label = |(cell, is)| CellLabel { cell, is, weight: 0.5 };
        let (cell, anchor, codes, bin) = (7, 3, [0.25; 7], 1);
        let targets = Targets {
            positives: vec![Positive { cell, anchor, codes, bin }],
            ignored: vec![9, 11],
            cells: cells.map(label).to_vec(),
        };
        let mut bytes = vec![];
        write_frame(&voxels, &targets, &mut bytes);
        let bits = f32::to_bits;
        let row = [0.05, 0.05, 0.1, 0.0].map(bits);
        let labels = [9, 11, 7, 2, bits(0.5), 8, u32::MAX, bits(0.5)];
        let words = [&row[..], &[7, 3, 1], &codes.map(bits), &labels].concat();
        let (counts, place) = ([1_u32, 1, 2, 2].map(u32::to_le_bytes), [4, 0, 0, 2, 0, 2]);
        let words: Vec<u8> = words.into_iter().flat_map(u32::to_le_bytes).collect();
        assert_eq!(bytes, [counts.as_flattened(), &place, &words].concat());
    }
}
