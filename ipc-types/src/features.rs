//! Feature rows of the bird's-eye map: for each computed cell its index and its channels.
//!
//! A features message is a slice of 64-byte blocks: first the cell indices (u32, sixteen per block, the last block padded with [`u32::MAX`]),
//! then the rows (channels / 16 blocks each). An absent cell equals the model's response to an empty scene, which has no candidate
//! (`empty_objectness_max` of the manifest). If boxes are measured from the ground, z at its grid nodes ends the message (f32, m, sixteen per block).

use crate::error::{Result, check_equal, check_length, require};
use crate::{CELLS_MAX, ContractError, FEATURE_CHANNELS_MAX, FrameHeader};
use bytemuck::{Pod, Zeroable};
#[cfg(feature = "iceoryx2")]
use iceoryx2::prelude::ZeroCopySend;

/// 64 bytes, aligned: rows can be read by the widest vector units.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[cfg_attr(feature = "iceoryx2", derive(ZeroCopySend))]
#[cfg_attr(feature = "iceoryx2", type_name("mluc.FeatureBlock"))]
#[repr(C)]
#[repr(align(64))]
pub struct FeatureBlock(pub [f32; 16]);

const _: () = assert!(size_of::<FeatureBlock>() == 64 && align_of::<FeatureBlock>() == 64);

/// Blocks that `rows` rows of `channels` channels and `ground_nodes` heights take.
pub const fn feature_blocks(rows: usize, channels: usize, ground_nodes: usize) -> usize {
    rows.div_ceil(16) + rows * channels / 16 + ground_nodes.div_ceil(16)
}

/// A features message, checked.
#[derive(Clone, Copy, Debug)]
pub struct FeatureRows<'a> {
    /// Cell (row * columns + column) of each row, ascending.
    pub cells: &'a [u32],
    /// `cells.len() * channels` values.
    pub rows: &'a [f32],
    /// z of the ground at the nodes of its grid, m; empty if boxes are not measured from the ground.
    pub ground_m: &'a [f32],
}

impl<'a> FeatureRows<'a> {
    /// Checks lengths and that every cell lies on a map of `map_cells` cells, in ascending order.
    pub fn checked(
        header: &FrameHeader,
        blocks: &'a [FeatureBlock],
        map_cells: usize,
        channels: usize,
        ground_nodes: usize,
    ) -> Result<FeatureRows<'a>> {
        header.checked()?;
        let rows = header.feature_rows as usize;
        let map_cells = map_cells.min(CELLS_MAX);
        check_length("feature rows", rows, map_cells)?;
        check_length("feature channels", channels, FEATURE_CHANNELS_MAX)?;
        let what = "feature channels";
        check_equal(what, header.feature_channels.into(), channels as u64)?;
        let whole = channels.next_multiple_of(16) as u64;
        check_equal(what, channels as u64, whole)?;
        let expected = feature_blocks(rows, channels, ground_nodes) as u64;
        check_equal("feature blocks", blocks.len() as u64, expected)?;
        let (cells, values) = blocks.split_at(rows.div_ceil(16));
        let (values, ground) = values.split_at(rows * channels / 16);
        let cells: &[u32] = &bytemuck::cast_slice(cells)[..rows];
        let ascending = cells.windows(2).all(|pair| pair[0] < pair[1]);
        let found = cells.last().map_or(0, |last| *last as usize);
        let are_on_map = cells.is_empty() || ascending && found < map_cells;
        let (what, len) = ("cell of a feature row", map_cells);
        require(are_on_map, ContractError::Index(what, len, found))?;
        Ok(FeatureRows {
            cells,
            rows: bytemuck::cast_slice(values),
            ground_m: &bytemuck::cast_slice(ground)[..ground_nodes],
        })
    }

    /// Splits a loaned message of [`feature_blocks`] blocks into cells and rows to be written; pads the cells and writes the ground.
    pub fn split_mut<'b>(
        blocks: &'b mut [FeatureBlock],
        rows: usize,
        ground_m: &[f32],
    ) -> (&'b mut [u32], &'b mut [f32]) {
        let (cells, values) = blocks.split_at_mut(rows.div_ceil(16));
        let cells: &mut [u32] = bytemuck::cast_slice_mut(cells);
        cells[rows..].fill(u32::MAX);
        let (values, ground) = values.split_at_mut(values.len() - ground_m.len().div_ceil(16));
        let ground: &mut [f32] = bytemuck::cast_slice_mut(ground);
        ground[ground_m.len()..].fill(0.0);
        ground[..ground_m.len()].copy_from_slice(ground_m);
        (&mut cells[..rows], bytemuck::cast_slice_mut(values))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MAP_CELLS: usize = 400;
    const CHANNELS: usize = 32;
    const GROUND: [f32; 3] = [-1.0, -1.5, -2.0];

    /// A sound message of `rows` rows, cells 3, 6, 9, ...
    fn message(rows: usize) -> (FrameHeader, Vec<FeatureBlock>) {
        let mut header = FrameHeader::new(0, "a");
        header.feature_rows = rows as u32;
        header.feature_channels = CHANNELS as u32;
        let mut blocks =
            vec![FeatureBlock([0.0; 16]); feature_blocks(rows, CHANNELS, GROUND.len())];
        let (cells, values) = FeatureRows::split_mut(&mut blocks, rows, &GROUND);
        for (row, cell) in cells.iter_mut().enumerate() {
            *cell = 3 * (row as u32 + 1);
        }
        for (number, value) in values.iter_mut().enumerate() {
            *value = number as f32;
        }
        (header, blocks)
    }

    fn check(header: &FrameHeader, blocks: &[FeatureBlock]) -> Result<()> {
        FeatureRows::checked(header, blocks, MAP_CELLS, CHANNELS, GROUND.len()).map(drop)
    }

    #[test]
    fn what_is_written_is_read() {
        for rows in [0, 1, 15, 16, 17, 100] {
            let (header, blocks) = message(rows);
            let read =
                FeatureRows::checked(&header, &blocks, MAP_CELLS, CHANNELS, GROUND.len()).unwrap();
            let cells: Vec<u32> = (1..=rows as u32).map(|row| 3 * row).collect();
            let values: Vec<f32> = (0..rows * CHANNELS).map(|number| number as f32).collect();
            assert_eq!((read.cells, read.rows), (&cells[..], &values[..]));
            assert_eq!(read.ground_m, GROUND);
        }
    }

    #[test]
    fn lengths_must_agree() {
        let (sound, blocks) = message(20);
        let error = |rows, channels, blocks: &[FeatureBlock]| {
            let mut header = sound;
            (header.feature_rows, header.feature_channels) = (rows, channels);
            check(&header, blocks).unwrap_err().to_string()
        };
        assert!(error(20, 32, &blocks[1..]).contains("blocks: expected 43, found 42"));
        assert!(error(21, 32, &blocks).contains("blocks: expected 45, found 43"));
        assert!(error(u32::MAX, 32, &blocks).contains("exceeds the limit of 400"));
        assert!(error(20, 48, &blocks).contains("channels: expected 32, found 48"));
    }

    #[test]
    fn cells_must_ascend_and_lie_on_the_map() {
        let changed = |block: usize, place: usize, cell: usize| {
            let (header, mut blocks) = message(20);
            blocks[block].0[place] = f32::from_bits(cell as u32);
            check(&header, &blocks)
        };
        for (block, place, cell) in [(0, 4, 1), (1, 3, MAP_CELLS)] {
            let error = changed(block, place, cell).unwrap_err();
            assert!(matches!(error, ContractError::Index(..)));
        }
        assert_eq!(changed(1, 3, MAP_CELLS - 1), Ok(()));
    }
}
