//! Points to voxels: each voxel's row is the mean of its first points (paper section 3.1; the mean encoder of SECOND).

use crate::sites::Sites;
use mluc_ipc_types::POINTS_MAX;
use mluc_kernels::at_best;
use mluc_model::Grid;
use rayon::prelude::*;

/// Values in place of an address; no address is as large.
const NON_FINITE: usize = usize::MAX;
const OUT_OF_RANGE: usize = usize::MAX - 1;
/// Number of points per task: about 50 microseconds of work.
pub(crate) const POINTS_A_TASK: usize = 8192;
/// Channels of a voxel's row: x, y, z (m), intensity.
pub const VOXEL_CHANNELS: usize = 4;

/// Counts of a scan's points: used, or left out and why.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PointCounts {
    /// Number of points of the scan.
    pub points: u32,
    /// Points left out because a coordinate or the intensity is NaN or infinite.
    pub non_finite: u32,
    /// Points left out because they are outside the grid, or at the origin.
    pub out_of_range: u32,
    /// Points left out because they would have opened a voxel beyond `voxels_max`.
    pub over_voxels_max: u32,
    /// Points inside the grid.
    pub in_range: u32,
    /// Number of voxels.
    pub voxels: u32,
}

/// The voxels of one scan; reused from frame to frame.
#[derive(Clone, Debug)]
pub struct Voxels {
    /// Occupied voxels of the grid; it has the depth of the network's first sparse map.
    pub sites: Sites,
    /// One row per site: mean x, y, z (m, sensor frame), intensity; or after `localize` offsets (voxels), height above the ground (m), 0.
    pub rows: Vec<f32>,
    /// Address of every point's voxel, or the reason why it has none.
    addresses: Vec<usize>,
    /// Address and point number of every point that has a voxel, in file order.
    placed: Vec<(usize, u32)>,
    points_of_site: Vec<u32>,
}

impl Voxels {
    /// Memory for scans on `grid` with as many points as the contract allows; larger scans allocate more.
    pub fn new(grid: &Grid) -> Voxels {
        let voxels_max = grid.voxels_max as usize;
        let mut sites = Sites::new(grid.sparse_shape());
        sites.reserve(voxels_max);
        Voxels {
            sites,
            rows: Vec::with_capacity(voxels_max * VOXEL_CHANNELS),
            addresses: Vec::with_capacity(POINTS_MAX),
            placed: Vec::with_capacity(POINTS_MAX),
            points_of_site: Vec::with_capacity(voxels_max),
        }
    }
}

/// Sorts points (x, y, z in m, intensity 0..1; file order) into voxels.
///
/// A point's voxel is floor((p - min) / size) in f32. A voxel averages its first `points_per_voxel_max` points; the
/// first `voxels_max` distinct voxels in file order are kept. Without `uses_intensity` the fourth channel is 0.
pub fn voxelize(
    points: &[[f32; 4]],
    grid: &Grid,
    uses_intensity: bool,
    voxels: &mut Voxels,
) -> PointCounts {
    let counts = place(points, grid, voxels);
    voxels.sites.finish();
    average(points, grid, uses_intensity, voxels);
    counts
}

/// Converts rows with heights above the ground to rows of [`mluc_model::VoxelInput::Local`]: mean x and y become the offset from the
/// voxel's centre, in voxels; intensity becomes 0.
pub fn localize(grid: &Grid, voxels: &mut Voxels) {
    let sites = voxels.sites.coordinates();
    for (row, [_, y, x]) in voxels.rows.chunks_exact_mut(VOXEL_CHANNELS).zip(sites) {
        for (axis, cell) in [x, y].into_iter().enumerate() {
            let at = (row[axis] - grid.range_min_m[axis]) / grid.voxel_size_m[axis];
            row[axis] = at - (f32::from(*cell) + 0.5);
        }
        row[3] = 0.0;
    }
}

/// Opens the voxels and records the voxel of each point.
fn place(points: &[[f32; 4]], grid: &Grid, voxels: &mut Voxels) -> PointCounts {
    let mut counts = PointCounts { points: points.len() as u32, ..PointCounts::default() };
    voxels.sites.clear();
    voxels.placed.clear();
    voxels.addresses.resize(points.len(), OUT_OF_RANGE);
    let (sites, addresses) = (&mut voxels.sites, &mut voxels.addresses);
    let tasks = addresses.par_chunks_mut(POINTS_A_TASK);
    tasks
        .zip(points.par_chunks(POINTS_A_TASK))
        .for_each(|(addresses, points)| find(points, grid, sites, addresses));
    for (number, &address) in addresses.iter().enumerate() {
        match address {
            NON_FINITE => counts.non_finite += 1,
            OUT_OF_RANGE => counts.out_of_range += 1,
            _ => {
                counts.in_range += 1;
                if sites.len() >= grid.voxels_max as usize && !sites.contains(address) {
                    counts.over_voxels_max += 1;
                } else {
                    sites.insert_at(address);
                    voxels.placed.push((address, number as u32));
                }
            }
        }
    }
    counts.voxels = sites.len() as u32;
    counts
}

/// Square of the minimum range, m²: nearer are missing returns, and text or other numbers that are read as coordinates.
pub const NEAREST_SQUARED: f32 = 0.01;

/// Finds the address of each point's voxel.
fn find(points: &[[f32; 4]], grid: &Grid, sites: &Sites, addresses: &mut [usize]) {
    let cells = grid.cells().map(|cells| cells as f32);
    at_best!({
        for (point, address) in points.iter().zip(addresses) {
            // Not negative inside the grid, so that the cast below is the floor.
            let cell = [0, 1, 2].map(|i| (point[i] - grid.range_min_m[i]) / grid.voxel_size_m[i]);
            let inside = |i: usize| (cell[i] >= 0.0) & (cell[i] < cells[i]);
            let [x, y, z] = cell.map(|cell| cell as usize);
            let near = point[0] * point[0] + point[1] * point[1] + point[2] * point[2];
            *address = if !point.iter().all(|value| value.is_finite()) {
                NON_FINITE
            } else if inside(0) & inside(1) & inside(2) & (near >= NEAREST_SQUARED) {
                sites.address(z, y, x)
            } else {
                OUT_OF_RANGE
            };
        }
    });
}

/// Fills the rows with the means.
fn average(points: &[[f32; 4]], grid: &Grid, uses_intensity: bool, voxels: &mut Voxels) {
    let (sites, rows) = (&voxels.sites, &mut voxels.rows);
    let points_of_site = &mut voxels.points_of_site;
    rows.clear();
    rows.resize(sites.len() * VOXEL_CHANNELS, 0.0);
    points_of_site.clear();
    points_of_site.resize(sites.len(), 0);
    for &(address, number) in &voxels.placed {
        let site = sites.index_at(address) as usize;
        if points_of_site[site] < grid.points_per_voxel_max {
            points_of_site[site] += 1;
            let row = &mut rows[site * VOXEL_CHANNELS..][..VOXEL_CHANNELS];
            row.iter_mut().zip(points[number as usize]).for_each(|(sum, value)| *sum += value);
        }
    }
    for (row, count) in rows.chunks_exact_mut(VOXEL_CHANNELS).zip(points_of_site) {
        row.iter_mut().for_each(|sum| *sum /= *count as f32);
        if !uses_intensity {
            row[3] = 0.0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mluc_geometry::Random;

    fn grid() -> Grid {
        Grid {
            range_min_m: [0.0, -2.0, -1.0],
            range_max_m: [6.0, 2.0, 1.0],
            voxel_size_m: [0.5, 0.5, 0.5],
            points_per_voxel_max: 3,
            voxels_max: 200,
        }
    }

    fn scan(count: usize, seed: u64) -> Vec<[f32; 4]> {
        let mut random = Random::from_state(seed);
        let ranges = [(-0.5, 6.5), (-2.5, 2.5), (-1.2, 1.2), (0.0, 1.0)];
        let point = |_| ranges.map(|(low, high)| random.uniform(low, high) as f32);
        (0..count).map(point).collect()
    }

    /// A simple implementation, voxel by voxel with a map and lists.
    fn plain(points: &[[f32; 4]], grid: &Grid) -> (Vec<[usize; 3]>, Vec<f32>, u32) {
        let mut voxels = std::collections::BTreeMap::<[usize; 3], Vec<[f32; 4]>>::new();
        let mut left_out = 0;
        for point in points {
            if point[..3].iter().map(|v| v * v).sum::<f32>() < NEAREST_SQUARED {
                continue;
            }
            let at = [2, 1, 0]
                .map(|i| ((point[i] - grid.range_min_m[i]) / grid.voxel_size_m[i]).floor());
            let cells = grid.cells();
            let mut places = at.into_iter().zip([cells[2], cells[1], cells[0]]);
            if !places.all(|(at, edge)| at >= 0.0 && at < edge as f32) {
                continue;
            }
            let at = at.map(|at| at as usize);
            if voxels.len() == grid.voxels_max as usize && !voxels.contains_key(&at) {
                left_out += 1;
                continue;
            }
            voxels.entry(at).or_default().push(*point);
        }
        let rows = voxels.values().flat_map(|points| {
            let kept = &points[..points.len().min(grid.points_per_voxel_max as usize)];
            [0, 1, 2, 3]
                .map(|i| kept.iter().map(|p| p[i]).fold(0.0, |a, b| a + b) / kept.len() as f32)
        });
        (voxels.keys().copied().collect(), rows.collect(), left_out)
    }

    #[test]
    fn agrees_with_the_plain_version() {
        let mut voxels = Voxels::new(&grid());
        for (count, seed) in [(0, 1), (150, 2), (3000, 3), (900, 4)] {
            let points = scan(count, seed);
            let counts = voxelize(&points, &grid(), true, &mut voxels);
            let (sites, rows, left_out) = plain(&points, &grid());
            let found = voxels.sites.coordinates().iter();
            assert!(found.map(|c| c.map(usize::from)).eq(sites.iter().copied()));
            assert_eq!(voxels.rows, rows);
            assert_eq!(counts.over_voxels_max, left_out);
            assert_eq!(counts.voxels as usize, sites.len());
            let all = counts.in_range + counts.out_of_range + counts.non_finite;
            assert_eq!(all, count as u32);
            // The largest scan reaches the limits.
            let is_large = count == 3000;
            assert!(!is_large || counts.over_voxels_max > 0 && counts.out_of_range > 0);
        }
    }

    #[test]
    fn points_that_are_no_numbers_are_counted_and_left_out() {
        let bad = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY];
        let mut points: Vec<[f32; 4]> = bad.iter().map(|v| [1.0, *v, 0.0, 0.5]).collect();
        points.push([1.0, 0.0, 0.0, f32::NAN]);
        points.push([f32::MAX, 0.0, 0.0, 0.5]);
        points.push([1.0, 0.0, 0.0, 0.5]);
        let mut voxels = Voxels::new(&grid());
        let counts = voxelize(&points, &grid(), false, &mut voxels);
        let found = (counts.non_finite, counts.out_of_range, counts.in_range);
        assert_eq!(found, (4, 1, 1));
        assert_eq!(voxels.rows, [1.0, 0.0, 0.0, 0.0]);
    }

    #[test]
    fn borders_belong_to_the_cell_above() {
        let points = [
            [0.0, -2.0, -1.0, 0.0],
            [0.5, 0.0, 0.0, 0.0],
            [6.0, 0.0, 0.0, 0.0],
            [0.0, 0.0, 1.0, 0.0],
        ];
        let mut voxels = Voxels::new(&grid());
        let counts = voxelize(&points, &grid(), true, &mut voxels);
        assert_eq!(voxels.sites.coordinates(), [[0, 0, 0], [2, 4, 1]]);
        assert_eq!(counts.out_of_range, 2);
    }
}
