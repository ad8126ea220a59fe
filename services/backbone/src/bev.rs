//! The last sparse layer's sites as a bird's-eye map: heights become channels.
//!
//! The map is a list of rows, one a cell, in (y, x) order; channel = c * depth + z (paper section 3.1: the height is
//! folded into the channels, innermost).

use crate::sites::Sites;

/// Writes each site's row into its cell of `map` (`height * width` rows of `channels * depth`); the rest stays as it is.
pub fn scatter<T: Copy>(sites: &Sites, rows: &[T], channels: usize, map: &mut [T]) {
    let [depth, _, width] = sites.shape();
    for (site, row) in sites.coordinates().iter().zip(rows.chunks_exact(channels)) {
        let [z, y, x] = site.map(usize::from);
        let cell = &mut map[(y * width + x) * channels * depth..][..channels * depth];
        cell[z..]
            .iter_mut()
            .step_by(depth)
            .zip(row)
            .for_each(|(to, from)| *to = *from);
    }
}

/// The other way round, for the gradient: each site's row from its cell of `map`.
pub fn collect(sites: &Sites, map: &[f32], channels: usize, rows: &mut [f32]) {
    let [depth, _, width] = sites.shape();
    for (site, row) in sites
        .coordinates()
        .iter()
        .zip(rows.chunks_exact_mut(channels))
    {
        let [z, y, x] = site.map(usize::from);
        let cell = &map[(y * width + x) * channels * depth..][..channels * depth];
        row.iter_mut()
            .zip(cell[z..].iter().step_by(depth))
            .for_each(|(to, from)| *to = *from);
    }
}

/// Zeroes the cells that [`scatter`] wrote.
pub fn clear(sites: &Sites, channels: usize, map: &mut [f32]) {
    let [depth, _, width] = sites.shape();
    for site in sites.coordinates() {
        let [_, y, x] = site.map(usize::from);
        map[(y * width + x) * channels * depth..][..channels * depth].fill(0.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depth_is_innermost_and_the_way_back_is_exact() {
        let mut sites = Sites::new([2, 2, 3]);
        sites.insert(0, 1, 2);
        sites.insert(1, 1, 2);
        sites.insert(1, 0, 0);
        sites.finish();
        let rows = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
        let mut map = vec![0.0; 2 * 3 * 4];
        scatter(&sites, &rows, 2, &mut map);
        let mut expected = vec![0.0; 24];
        expected[20..].copy_from_slice(&[1.0, 5.0, 2.0, 6.0]);
        expected[..4].copy_from_slice(&[0.0, 3.0, 0.0, 4.0]);
        assert_eq!(map, expected);
        let mut back = [0.0; 6];
        collect(&sites, &map, 2, &mut back);
        assert_eq!(back, rows);
        clear(&sites, 2, &mut map);
        assert_eq!(map, [0.0; 24]);
    }
}
