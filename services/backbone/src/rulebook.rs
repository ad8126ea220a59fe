//! The input site that each tap of each output site reads ("rulebook" in the sparse-convolution literature).
//!
//! A submanifold layer keeps its input's sites; a strided layer has a site wherever the window contains any input, or, with `floor`,
//! at floor(site / stride) of each input. Taps are in (kz, ky, kx) order, the order of the weights.

use crate::sites::{Sites, even_bits};
use mluc_kernels::{ABSENT, Gather, at_best};
use mluc_model::{KERNEL_MAX, SparseLayer};
use rayon::prelude::*;

/// Number of output sites that one task looks up: about 50 microseconds of work.
const ROWS_A_TASK: usize = 1024;

/// The sites of a strided layer. `output` has the layer's output shape.
pub(crate) fn output_sites(layer: &SparseLayer, input: &Sites, output: &mut Sites) {
    output.clear();
    let along_x = (layer.kernel[2], layer.stride[2], layer.padding[2]);
    match along_x {
        (1, 1, 0) => insert_words(layer, input, output, |word| word),
        (3, 2, 1) if layer.floor => {
            insert_words(layer, input, output, |word| even_bits(word | word >> 1))
        }
        (3, 2, 1) => insert_words(layer, input, output, halved),
        _ => insert_cells(layer, input, output),
    }
    output.finish();
}

fn insert_cells(layer: &SparseLayer, input: &Sites, output: &mut Sites) {
    let shape = output.shape();
    for site in input.coordinates() {
        let [z, y, x] = [0, 1, 2].map(|i| readers(layer, i, site[i].into(), shape[i]));
        for z in z {
            for y in y.clone() {
                for x in x.clone() {
                    output.insert(z, y, x);
                }
            }
        }
    }
}

/// Inserts 64 cells of an x-row at a time: `readers_of` maps a word of input cells from x on to the cells from x / stride on that read them.
fn insert_words(
    layer: &SparseLayer,
    input: &Sites,
    output: &mut Sites,
    readers_of: impl Fn(u64) -> u64,
) {
    let shape = output.shape();
    for ([z, y, x], word) in input.words() {
        let [zs, ys] = [(0, z), (1, y)].map(|(i, at)| readers(layer, i, at, shape[i]));
        let found = readers_of(word);
        for z in zs {
            for y in ys.clone() {
                output.insert_word(z, y, x / layer.stride[2], found);
            }
        }
    }
}

/// Windows of three cells around every second cell: cell o reads 2 o - 1 to 2 o + 1. The first cell beyond the 32 also reads the last input.
fn halved(word: u64) -> u64 {
    even_bits(word | word << 1 | word >> 1) | (word >> 63) << 32
}

/// Output positions along one axis that exist for `at`: all o with 0 <= at - (o * stride - padding) < kernel; with `floor` floor(at / stride).
fn readers(layer: &SparseLayer, axis: usize, at: usize, edge: usize) -> std::ops::Range<usize> {
    let (kernel, stride) = (layer.kernel[axis], layer.stride[axis]);
    if layer.floor {
        return (at / stride).min(edge)..(at / stride + 1).min(edge);
    }
    let last_covered = at + layer.padding[axis];
    let first = (last_covered + 1).saturating_sub(kernel).div_ceil(stride);
    first..(last_covered / stride + 1).min(edge)
}

/// The gather of a layer from `input`'s rows to `output`'s (the same sites for a submanifold layer).
pub(crate) fn gather(layer: &SparseLayer, input: &Sites, output: &Sites, table: &mut Gather) {
    table.taps = layer.taps();
    // Every entry is written below.
    table.index.resize(output.len() * table.taps, ABSENT);
    let rows = table.index.par_chunks_mut(ROWS_A_TASK * table.taps);
    rows.zip(output.coordinates().par_chunks(ROWS_A_TASK))
        .for_each(|(rows, sites)| at_best!(look_up(layer, input, sites, rows)));
}

/// Looks up the taps of output sites, inlined down to the population count. Sites of one x-row read the same x-rows of the input.
#[inline(always)]
fn look_up(layer: &SparseLayer, input: &Sites, sites: &[[u16; 3]], taps: &mut [u32]) {
    let origin = |site: [u16; 3], i: usize| {
        usize::from(site[i]) as isize * layer.stride[i] as isize - layer.padding[i] as isize
    };
    let [depth, height, width] = layer.kernel;
    let mut x_rows = [None; KERNEL_MAX * KERNEL_MAX];
    let mut before = None;
    for (taps, &site) in taps.chunks_exact_mut(layer.taps()).zip(sites) {
        let [z, y, x] = [0, 1, 2].map(|i| origin(site, i));
        if before.replace([z, y]) != Some([z, y]) {
            for (number, x_row) in x_rows[..depth * height].iter_mut().enumerate() {
                let step = [number / height, number % height].map(|step| step as isize);
                *x_row = input.x_row(z + step[0], y + step[1]);
            }
        }
        // The common widths are constants: with a constant length the loop over a row of taps unrolls.
        match width {
            1 => look_along::<1>(input, &x_rows, x, taps),
            3 => look_along::<3>(input, &x_rows, x, taps),
            _ => {
                let taps = taps.chunks_exact_mut(width);
                (taps.zip(&x_rows)).for_each(|(taps, row)| input.look_along(*row, x, taps));
            }
        }
    }
}

#[inline(always)]
fn look_along<const WIDTH: usize>(
    input: &Sites,
    x_rows: &[Option<usize>],
    x: isize,
    taps: &mut [u32],
) {
    let (taps, _) = taps.as_chunks_mut::<WIDTH>();
    for (taps, row) in taps.iter_mut().zip(x_rows) {
        input.look_along(*row, x, taps);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{random_sites, rulebook};
    use mluc_model::{Grid, Network};

    /// Computes every output cell and every tap by the definition.
    fn brute_force(layer: &SparseLayer, input: &Sites) -> (Vec<[u16; 3]>, Vec<u32>) {
        let [depth, height, width] = layer.output_shape(input.shape());
        let [_, rows, columns] = layer.kernel;
        let (mut sites, mut index) = (vec![], vec![]);
        for cell in 0..depth * height * width {
            let at = [cell / (height * width), cell / width % height, cell % width];
            let site = at.map(|v| v as u16);
            let read = |tap: usize| {
                let k = [tap / (rows * columns), tap / columns % rows, tap % columns];
                let padded = [0, 1, 2].map(|i| (at[i] * layer.stride[i] + k[i]) as i64);
                let read = [0, 1, 2].map(|i| padded[i] - layer.padding[i] as i64);
                let row = input.coordinates().iter().position(|site| site.map(i64::from) == read);
                row.map_or(ABSENT, |row| row as u32)
            };
            let taps: Vec<u32> = (0..layer.taps()).map(read).collect();
            let exists = if layer.submanifold {
                input.coordinates().contains(&site)
            } else if layer.floor {
                let mut sites = input.coordinates().iter();
                sites.any(|site| (0..3).all(|i| site[i] as usize / layer.stride[i] == at[i]))
            } else {
                taps.iter().any(|tap| *tap != ABSENT)
            };
            if exists {
                sites.push(site);
                index.extend(taps);
            }
        }
        (sites, index)
    }

    #[test]
    fn tables_agree_with_the_definition_for_every_kind_of_layer() {
        let second = Network::second(Grid::kitti_second(), 3);
        for (number, shape, count, floor) in [
            (0, [6, 9, 70], 300),
            (2, [7, 10, 67], 200),
            (8, [6, 8, 66], 200),
            (11, [5, 6, 7], 60),
            (2, [3, 5, 200], 700),
            (11, [5, 3, 200], 150),
            (2, [4, 4, 4], 0),
        ]
        .into_iter()
        .flat_map(|(number, shape, count)| [false, true].map(|floor| (number, shape, count, floor)))
        {
            let layer = &SparseLayer {
                floor: floor && !second.sparse[number].submanifold,
                ..second.sparse[number].clone()
            };
            let input = random_sites(shape, count, number as u64);
            let (output, table) = rulebook(layer, &input);
            let (sites, index) = brute_force(layer, &input);
            assert_eq!(output.coordinates(), sites, "{}", layer.name);
            assert_eq!(table.index, index, "{}", layer.name);
            assert_eq!(table.taps, layer.taps());
        }
    }
}
