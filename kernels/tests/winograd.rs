//! Tiles of 2x2 outputs equal the direct convolution: exactly for counts, up to rounding for f32, with the registers of every level.

mod common;

use common::{Input, Random, assert_near, assert_refused, with_threads};
use mluc_kernels::{
    Epilogue, Level, Tiled, Weights, WeightsWinograd, WinogradTiles, convolve, convolve_winograd,
};

/// A layer on a map; only some cells are wanted.
struct Case<I> {
    shape: [usize; 2],
    cin: usize,
    cout: usize,
    input: Vec<I>,
    weights: Vec<f32>,
    bias: Vec<f32>,
    cells: Vec<u32>,
}

impl<I: Input + Tiled> Case<I> {
    fn new(shape: [usize; 2], cin: usize, cout: usize, wanted_percent: usize) -> Case<I> {
        let mut random = Random((shape[0] * 1000 + shape[1] + cin + 7 * cout) as u64);
        let cells = shape[0] * shape[1];
        Case {
            shape,
            cin,
            cout,
            input: I::inputs(&mut random, cells * cin),
            weights: I::weights(&mut random, 9 * cin * cout, cout),
            bias: I::bias(&mut random, cout),
            cells: (0..cells as u32).filter(|_| random.below(100) < wanted_percent).collect(),
        }
    }

    fn tiles(&self) -> WinogradTiles {
        let mut tiles = WinogradTiles::new(self.shape);
        tiles.assign(&self.cells, self.shape);
        tiles
    }

    fn packed(&self) -> WeightsWinograd<I> {
        WeightsWinograd::pack(self.cin, self.cout, &self.weights).expect("channels that fit")
    }

    /// The direct result in the wanted cells, 7 in the others.
    fn expected(&self, relu: bool) -> Vec<f64> {
        let [rows, columns] = self.shape;
        let gather = common::dense(columns, rows);
        let input: Vec<f32> = self.input.iter().map(|x| x.to_f32()).collect();
        let mut map = common::convolve(&input, self.cin, &gather, &self.weights, self.cout);
        for (i, y) in map.iter_mut().enumerate() {
            *y = I::value(*y, self.bias[i % self.cout]);
            *y = if relu { y.max(0.0) } else { *y };
            if !self.cells.contains(&((i / self.cout) as u32)) {
                *y = 7.0;
            }
        }
        map
    }

    /// Runs on a map that is filled with 7.
    fn run_at(&self, level: Level, relu: bool) -> Vec<f32> {
        let mut output = self.blank();
        let (input, tiles, weights) = (&self.input, self.tiles(), self.packed());
        let bias = Some(&self.bias[..]);
        let epilogue = Epilogue { bias, relu };
        convolve_winograd(level, input, &tiles, &weights, epilogue, &mut output);
        output
    }

    fn run(&self) -> Vec<f32> {
        self.run_at(Level::best(), true)
    }

    fn blank(&self) -> Vec<f32> {
        vec![7.0; self.shape[0] * self.shape[1] * self.cout]
    }
}

#[test]
fn every_level_gives_the_direct_result_in_the_wanted_cells_and_writes_no_other() {
    every_level::<f32>(1e-5);
    every_level::<i16>(0.0);
}

fn every_level<I: Input + Tiled>(tolerance: f64) {
    for (shape, cin, cout, wanted) in [
        ([1, 1], 16, 16, 100),
        ([2, 2], 16, 32, 100),
        ([5, 7], 32, 48, 60),
        ([9, 30], 48, 96, 30),
        ([13, 20], 96, 48, 100),
        ([40, 33], 64, 64, 80),
        ([6, 11], 128, 128, 50),
        ([4, 9], 256, 80, 100),
        ([4, 4], 16, 16, 0),
        ([1, 9], 16, 16, 100),
        ([9, 1], 16, 16, 100),
        ([4, 30], 512, 16, 100),
        ([10, 12], 256, 32, 100),
    ] {
        let cin = cin.max(I::STEP * 16);
        let case = Case::<I>::new(shape, cin, cout, wanted);
        for relu in [false, true] {
            let expected = case.expected(relu);
            for level in Level::all() {
                let found = case.run_at(level, relu);
                let what = format!("{}: {shape:?}, {cin} -> {cout}, {wanted} %", level.name());
                assert_near(&found, &expected, tolerance, &what);
                let kept = found.iter().zip(&expected).filter(|(_, e)| **e == 7.0);
                assert!(kept.clone().all(|(found, _)| *found == 7.0), "{what}");
            }
        }
    }
}

#[test]
fn the_bits_do_not_depend_on_threads_nor_on_which_other_cells_are_wanted() {
    let mut case = Case::<f32>::new([60, 44], 48, 96, 100);
    let run = |case: &Case<f32>, threads| with_threads(threads, || case.run());
    let all = run(&case, 1);
    assert!(run(&case, 2) == all && run(&case, 3) == all);
    case.cells.retain(|cell| cell % 7 < 3);
    let some = run(&case, 2);
    for cell in &case.cells {
        let row = *cell as usize * case.cout..(*cell as usize + 1) * case.cout;
        assert_eq!(some[row.clone()], all[row], "cell {cell}");
    }
}

/// Rows of cells far from each other: tasks with one empty half, and strips with more tiles than a task has.
#[test]
fn a_wall_along_a_row_of_an_empty_map_is_computed_wherever_it_lies() {
    let mut case = Case::<f32>::new([24, 260], 16, 16, 0);
    for walls in [&[0][..], &[23], &[11, 12], &[0, 1, 2, 23], &[8, 9, 10, 11]] {
        let rows = walls.iter().flat_map(|row| row * 260..(row + 1) * 260);
        case.cells = rows.collect();
        let expected = case.expected(true);
        let found = with_threads(2, || case.run());
        assert_near(&found, &expected, 1e-5, &format!("walls {walls:?}"));
    }
}

#[test]
fn tiles_of_the_last_frame_are_forgotten_and_a_bias_may_be_missing() {
    let mut case = Case::<f32>::new([12, 40], 32, 32, 70);
    let mut tiles = case.tiles();
    case.cells.retain(|cell| cell % 3 == 0);
    tiles.assign(&case.cells, case.shape);
    assert_eq!(tiles, case.tiles());
    case.bias.fill(0.0);
    let mut found = case.blank();
    let (level, packed, epilogue) = (Level::best(), case.packed(), Epilogue::default());
    convolve_winograd(level, &case.input, &tiles, &packed, epilogue, &mut found);
    assert_near(&found, &case.expected(false), 1e-5, "no bias");
}

/// The largest counts and weights; also rows of counts from rounded weights, which must equal the direct kernels' result on bytes.
#[test]
fn the_largest_sums_and_the_rounding_of_counts_are_the_direct_ones() {
    let (cin, cout) = (512, 16);
    let by_tap = |i: usize| 1.0 - 2.0 * (i / (cin * cout) % 2) as f32;
    let signs: [&dyn Fn(usize) -> f32; 3] = [&|_| 1.0, &|_| -1.0, &by_tap];
    for sign in signs {
        let mut case = Case::<i16>::new([6, 6], cin, cout, 100);
        case.input.fill(255);
        case.weights = (0..9 * cin * cout).map(|i| 127.0 * sign(i)).collect();
        let expected = case.expected(false);
        for level in Level::all() {
            assert_near(&case.run_at(level, false), &expected, 0.0, level.name());
        }
    }
    let mut case = Case::<i16>::new([9, 30], 96, 48, 100);
    let mut random = Random(3);
    let mut values = |count, scale: f32| random.values(count).iter().map(|v| v * scale).collect();
    (case.weights, case.bias) = (values(9 * 96 * 48, 0.01), values(48, 200.0));
    let bytes: Vec<u8> = case.input.iter().map(|x| *x as u8).collect();
    let weights = Weights::pack(9, 96, 48, &case.weights);
    let (bias, relu) = (Some(&case.bias[..]), true);
    let epilogue = Epilogue { bias, relu };
    let (mut direct, mut tiled) = (vec![0_u8; 270 * 48], vec![0_i16; 270 * 48]);
    let (gather, tiles, packed) = (common::dense(30, 9), case.tiles(), case.packed());
    convolve(&bytes, &gather, &weights, epilogue, None, &mut direct);
    let level = Level::best();
    convolve_winograd(level, &case.input, &tiles, &packed, epilogue, &mut tiled);
    assert!(direct.iter().copied().map(i16::from).eq(tiled));
    let inner = direct.iter().filter(|count| (1..255).contains(*count));
    assert!(inner.count() > 1000);
}

#[test]
fn a_value_that_is_not_a_number_reaches_the_cells_that_read_it_and_no_other() {
    let mut case = Case::<f32>::new([7, 8], 16, 16, 100);
    let input = case.input.clone();
    for (y, x) in [(0, 0), (1, 1), (2, 3), (3, 2), (6, 7)] {
        case.input.clone_from(&input);
        case.input[(y * 8 + x) * 16] = f32::NAN;
        let output = case.run();
        for (cell, row) in output.chunks_exact(16).enumerate() {
            let reads = (cell / 8).abs_diff(y) <= 1 && (cell % 8).abs_diff(x) <= 1;
            assert!(row.iter().all(|value| value.is_nan() == reads), "{y}, {x}: cell {cell}");
        }
    }
}

#[test]
fn channels_that_are_not_whole_registers_or_too_many_are_left_to_the_direct_kernels() {
    for (cin, cout, fits) in [
        (16, 16, true),
        (512, 16, true),
        (1024, 16, false),
        (24, 16, false),
        (16, 24, false),
        (0, 16, false),
    ] {
        let zeros = vec![0.0; 9 * cin * cout];
        let packed = WeightsWinograd::<f32>::pack(cin, cout, &zeros);
        assert_eq!(packed.is_some(), fits, "{cin} -> {cout}");
        let packed = WeightsWinograd::<i16>::pack(cin, cout, &zeros);
        assert_eq!(packed.is_some(), fits && cin > 16, "{cin} -> {cout}, i16");
    }
}

#[test]
fn windows_cells_and_outputs_that_do_not_fit_are_refused() {
    let mut cut = Case::<f32>::new([4, 4], 16, 16, 100);
    cut.input.truncate(8 * 16);
    assert_refused("input row 15 of 8", || cut.run());
    let assign = |cells: &[u32]| WinogradTiles::new([4, 4]).assign(cells, [4, 4]);
    assert_refused("cell Some(16) of 4 x 4", || assign(&[3, 16]));
    assert_refused("cells that ascend", || assign(&[3, 2]));
    let case = Case::<f32>::new([4, 4], 16, 16, 100);
    let (level, tiles, weights) = (Level::best(), case.tiles(), case.packed());
    assert_refused("out of range", || {
        let (epilogue, output) = (Epilogue::default(), &mut [0.0; 12 * 16]);
        convolve_winograd(level, &case.input, &tiles, &weights, epilogue, output);
    });
}
