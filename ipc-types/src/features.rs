//! Feature rows of the bird's-eye map: for each computed cell its index and its channels.
//!
//! A features message is a slice of 64-byte blocks: first the cell indices (u32, sixteen a block, the last block padded
//! with [`u32::MAX`]), then the rows (channels / 16 blocks each). A cell that is absent equals the model's response to
//! an empty scene, which holds no candidate (`empty_objectness_max` of the manifest).

use bytemuck::{Pod, Zeroable};
#[cfg(feature = "iceoryx2")]
use iceoryx2::prelude::ZeroCopySend;

use crate::{CELLS_MAX, ContractError, FEATURE_CHANNELS_MAX, FrameHeader};

/// 64 bytes, aligned: rows can be read by the widest vector units.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[cfg_attr(
    feature = "iceoryx2",
    derive(ZeroCopySend),
    type_name("mluc.FeatureBlock")
)]
#[repr(C)]
#[repr(align(64))]
pub struct FeatureBlock(pub [f32; 16]);

const _: () = assert!(size_of::<FeatureBlock>() == 64 && align_of::<FeatureBlock>() == 64);

/// Blocks that `rows` rows of `channels` channels take.
pub const fn feature_blocks(rows: usize, channels: usize) -> usize {
    rows.div_ceil(16) + rows * channels / 16
}

/// A features message, checked.
#[derive(Clone, Copy, Debug)]
pub struct FeatureRows<'a> {
    /// Cell (row * columns + column) of each row, ascending.
    pub cells: &'a [u32],
    /// `cells.len() * channels` values.
    pub rows: &'a [f32],
    /// Channels of a row.
    pub channels: usize,
}

impl<'a> FeatureRows<'a> {
    /// Checks lengths and that every cell lies on a map of `map_cells` cells, in ascending order.
    pub fn checked(
        header: &FrameHeader,
        blocks: &'a [FeatureBlock],
        map_cells: usize,
        channels: usize,
    ) -> Result<FeatureRows<'a>, ContractError> {
        header.checked()?;
        let rows = header.feature_rows as usize;
        let map_cells = map_cells.min(CELLS_MAX);
        if rows > map_cells {
            return Err(ContractError::TooLong {
                what: "feature rows",
                limit: map_cells,
                found: rows,
            });
        }
        if channels > FEATURE_CHANNELS_MAX {
            return Err(ContractError::TooLong {
                what: "feature channels",
                limit: FEATURE_CHANNELS_MAX,
                found: channels,
            });
        }
        let mismatch = |what, expected: usize, found: usize| {
            Err(ContractError::Mismatch {
                what,
                expected: expected as u64,
                found: found as u64,
            })
        };
        if header.feature_channels as usize != channels || !channels.is_multiple_of(16) {
            return mismatch(
                "feature channels",
                channels,
                header.feature_channels as usize,
            );
        }
        if blocks.len() != feature_blocks(rows, channels) {
            return mismatch(
                "feature blocks",
                feature_blocks(rows, channels),
                blocks.len(),
            );
        }
        let (cells, values) = blocks.split_at(rows.div_ceil(16));
        let cells: &[u32] = &bytemuck::cast_slice(cells)[..rows];
        let ascending = cells.windows(2).all(|pair| pair[0] < pair[1]);
        match cells.last() {
            Some(&last) if !ascending || last as usize >= map_cells => Err(ContractError::Index {
                what: "cell of a feature row",
                len: map_cells,
                found: last as usize,
            }),
            _ => Ok(FeatureRows {
                cells,
                rows: bytemuck::cast_slice(values),
                channels,
            }),
        }
    }

    /// Splits a loaned message of [`feature_blocks`] blocks into cells and rows to be written; pads the cells.
    pub fn split_mut(blocks: &mut [FeatureBlock], rows: usize) -> (&mut [u32], &mut [f32]) {
        let (cells, values) = blocks.split_at_mut(rows.div_ceil(16));
        let cells: &mut [u32] = bytemuck::cast_slice_mut(cells);
        cells[rows..].fill(u32::MAX);
        (&mut cells[..rows], bytemuck::cast_slice_mut(values))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MAP_CELLS: usize = 400;
    const CHANNELS: usize = 32;

    /// A sound message of `rows` rows, cells 3, 6, 9, ...
    fn message(rows: usize) -> (FrameHeader, Vec<FeatureBlock>) {
        let mut header = FrameHeader::new(0, "a");
        header.feature_rows = rows as u32;
        header.feature_channels = CHANNELS as u32;
        let mut blocks = vec![FeatureBlock([0.0; 16]); feature_blocks(rows, CHANNELS)];
        let (cells, values) = FeatureRows::split_mut(&mut blocks, rows);
        for (row, cell) in cells.iter_mut().enumerate() {
            *cell = 3 * (row as u32 + 1);
        }
        for (number, value) in values.iter_mut().enumerate() {
            *value = number as f32;
        }
        (header, blocks)
    }

    fn check<'a>(
        header: &FrameHeader,
        blocks: &'a [FeatureBlock],
    ) -> Result<FeatureRows<'a>, ContractError> {
        FeatureRows::checked(header, blocks, MAP_CELLS, CHANNELS)
    }

    #[test]
    fn what_is_written_is_read() {
        for rows in [0, 1, 15, 16, 17, 100] {
            let (header, blocks) = message(rows);
            let read = check(&header, &blocks).unwrap();
            assert_eq!(read.cells.len(), rows);
            assert!(
                read.cells
                    .iter()
                    .enumerate()
                    .all(|(row, &cell)| cell == 3 * (row as u32 + 1))
            );
            assert_eq!(read.rows.len(), rows * CHANNELS);
            assert!(
                read.rows
                    .iter()
                    .enumerate()
                    .all(|(number, &value)| value == number as f32)
            );
        }
    }

    #[test]
    fn lengths_must_agree() {
        let (mut header, blocks) = message(20);
        assert!(matches!(
            check(&header, &blocks[1..]),
            Err(ContractError::Mismatch { .. })
        ));
        header.feature_rows = 21;
        assert!(matches!(
            check(&header, &blocks),
            Err(ContractError::Mismatch { .. })
        ));
        header.feature_rows = u32::MAX;
        assert!(matches!(
            check(&header, &blocks),
            Err(ContractError::TooLong { .. })
        ));
        header.feature_rows = 20;
        header.feature_channels = 48;
        assert!(matches!(
            check(&header, &blocks),
            Err(ContractError::Mismatch { .. })
        ));
    }

    #[test]
    fn cells_must_ascend_and_lie_on_the_map() {
        let (header, mut blocks) = message(20);
        blocks[0].0[4] = f32::from_bits(1);
        assert!(matches!(
            check(&header, &blocks),
            Err(ContractError::Index { .. })
        ));
        let (header, mut blocks) = message(20);
        blocks[1].0[3] = f32::from_bits(MAP_CELLS as u32);
        assert!(matches!(
            check(&header, &blocks),
            Err(ContractError::Index { .. })
        ));
        blocks[1].0[3] = f32::from_bits(MAP_CELLS as u32 - 1);
        assert!(check(&header, &blocks).is_ok());
    }

    #[test]
    fn too_many_channels_or_another_version_are_errors() {
        let (mut header, blocks) = message(4);
        let wide = FEATURE_CHANNELS_MAX + 16;
        assert!(matches!(
            FeatureRows::checked(&header, &blocks, MAP_CELLS, wide),
            Err(ContractError::TooLong { .. })
        ));
        header.wire_version = crate::WIRE_VERSION + 1;
        assert!(matches!(
            check(&header, &blocks),
            Err(ContractError::WireVersion { .. })
        ));
    }
}
