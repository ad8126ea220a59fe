//! Compares convolution and its gradients with the plain version, in every precision and on every register set of this machine.

mod common;

use common::{Input, Random, assert_near, assert_refused, with_threads};
use mluc_kernels::{
    ABSENT, Bf16, Element, Epilogue, Gather, Level, Trainable, Weights, convolve, convolve_at,
    weight_gradient,
};

const CHANNELS: [usize; 17] = [1, 2, 3, 4, 15, 16, 18, 31, 32, 48, 62, 63, 64, 84, 96, 128, 256];
const ROWS: [usize; 10] = [1, 2, 5, 7, 13, 16, 95, 96, 97, 301];
const TAPS: [usize; 5] = [1, 4, 9, 17, 27];
const TOLERANCE: f64 = 2e-6;

struct Case<I> {
    cin: usize,
    cout: usize,
    gather: Gather,
    input: Vec<I>,
    weights: Vec<f32>,
    bias: Option<Vec<f32>>,
    relu: bool,
}

impl<I: Input> Case<I> {
    fn random(seed: usize, cin: usize, cout: usize) -> Case<I> {
        let mut random = Random(seed as u64);
        let [outputs, inputs] = [(); 2].map(|()| ROWS[random.below(ROWS.len())]);
        // Large products are slow in the plain version; few taps are enough to test them.
        let taps = TAPS[random.below(if cin * cout > 4096 { 2 } else { TAPS.len() })];
        let absent_percent = [0, 0, 50, 90, 100][random.below(5)];
        let with_bias = random.below(2) == 0;
        Case {
            cin,
            cout,
            gather: random.gather(outputs, taps, inputs, absent_percent),
            input: I::inputs(&mut random, inputs * cin),
            weights: I::weights(&mut random, taps * cin * cout, cout),
            bias: with_bias.then(|| I::bias(&mut random, cout)),
            relu: random.below(2) == 0,
        }
    }

    /// The cases of all pairs of [`CHANNELS`].
    fn all() -> impl Iterator<Item = Case<I>> {
        let pairs_of = |cin: &usize| CHANNELS.map(|cout| (*cin, cout));
        let pairs = CHANNELS.iter().flat_map(pairs_of).enumerate();
        pairs.map(|(seed, (cin, cout))| Case::random(seed, cin, cout))
    }

    fn input(&self) -> Vec<f32> {
        self.input.iter().map(|x| x.to_f32()).collect()
    }

    fn expected(&self) -> Vec<f64> {
        let (cin, cout) = (self.cin, self.cout);
        let mut rows = common::convolve(&self.input(), cin, &self.gather, &self.weights, cout);
        for (i, y) in rows.iter_mut().enumerate() {
            *y = I::value(*y, self.bias.as_ref().map_or(0.0, |bias| bias[i % cout]));
            *y = if self.relu { y.max(0.0) } else { *y };
        }
        rows
    }

    fn run<O: Element>(&self, level: Level, rows: Option<&[u32]>, mut output: Vec<O>) -> Vec<O> {
        let weights = Weights::pack(self.gather.taps, self.cin, self.cout, &self.weights);
        let epilogue = Epilogue { bias: self.bias.as_deref(), relu: self.relu };
        let (input, gather) = (&self.input, &self.gather);
        convolve_at(level, input, gather, &weights, epilogue, rows, &mut output);
        output
    }

    fn name(&self, level: Level) -> String {
        let (taps, outputs) = (self.gather.taps, self.gather.outputs());
        let (level, cin, cout) = (level.name(), self.cin, self.cout);
        format!("{level} {cin} -> {cout}, {taps} taps, {outputs} rows")
    }
}

/// Returns how many sums are large.
fn forward_equals_plain<I: Input>() -> usize {
    let mut large = 0;
    for case in Case::<I>::all() {
        let expected = case.expected();
        let count = expected.len();
        large += expected.iter().filter(|value| value.abs() > 1e6).count();
        for level in Level::all() {
            let what = case.name(level);
            let output = case.run(level, None, vec![f32::NAN; count]);
            assert_near(&output, &expected, I::TOLERANCE, &what);
            let short = case.run(level, None, vec![Bf16::default(); count]);
            let rounded = output.iter().map(|y| Bf16::from_f32(*y));
            assert!(short.into_iter().eq(rounded), "{what}, bf16");
            let bytes = case.run(level, None, vec![7_u8; count]);
            let rounded = output.iter().map(|y| <u8 as Element>::from_f32(*y));
            assert!(bytes.into_iter().eq(rounded), "{what}, u8");
        }
    }
    large
}

#[test]
fn f32_equals_plain() {
    forward_equals_plain::<f32>();
}

#[test]
fn bf16_equals_plain() {
    forward_equals_plain::<Bf16>();
}

#[test]
fn bytes_give_the_exact_sums() {
    for large in [forward_equals_plain::<u8>(), forward_equals_plain::<i16>()] {
        assert!(large > 1000, "{large} large sums");
    }
}

#[test]
fn named_rows_are_written_and_no_other() {
    fn check<I: Input>(seed: u64) {
        let mut random = Random(seed);
        let [cin, cout] = [(); 2].map(|()| CHANNELS[random.below(CHANNELS.len())]);
        let case = Case::<I>::random(seed as usize, cin, cout);
        let outputs = case.gather.outputs();
        let rows: Vec<u32> = (0..outputs).map(|row| (2 * row + random.below(2)) as u32).collect();
        let output = vec![7.25; 2 * outputs * cout];
        let output = case.run(Level::best(), Some(&rows), output);
        let row = |row: u32| &output[row as usize * cout..][..cout];
        let named: Vec<f32> = rows.iter().flat_map(|at| row(*at)).copied().collect();
        assert_near(&named, &case.expected(), I::TOLERANCE, "named rows");
        for other in (0..2 * outputs as u32).filter(|row| !rows.contains(row)) {
            assert!(row(other).iter().all(|y| *y == 7.25), "row {other} is not named");
        }
    }
    for seed in 0..40 {
        check::<f32>(seed);
        check::<Bf16>(seed);
        check::<u8>(seed);
        check::<i16>(seed);
    }
}

#[test]
fn weight_gradient_equals_plain() {
    fn check<I: Input + Trainable>() {
        for case in Case::<I>::all() {
            let Case { cin, cout, .. } = case;
            let (input, gather) = (&case.input, &case.gather);
            let dy = I::inputs(&mut Random(3), gather.outputs() * cout);
            let plain: Vec<f32> = dy.iter().map(|dy| dy.to_f32()).collect();
            let mut expected = common::weight_gradient(&case.input(), cin, gather, &plain, cout);
            expected.iter_mut().for_each(|g| *g += 0.25);
            for level in Level::all() {
                let mut gradient = vec![0.25; expected.len()];
                weight_gradient(level, input, cin, gather, &dy, cout, &mut gradient);
                assert_near(&gradient, &expected, I::TOLERANCE, &case.name(level));
            }
        }
    }
    check::<f32>();
    check::<Bf16>();
}

/// The convolution without bias and ReLU, in the order of the rows.
fn plainly<I: Element>(input: &[I], gather: &Gather, weights: &Weights<I>) -> Vec<f32> {
    let mut output = vec![f32::NAN; gather.outputs() * weights.cout];
    let epilogue = Epilogue::default();
    convolve(input, gather, weights, epilogue, None, &mut output);
    output
}

/// The loss is `sum of y * dy`; its differences are taken in f64, where they are exact up to rounding.
#[test]
fn the_inputs_gradient_equals_finite_differences() {
    let (cin, cout, gather) = (5, 18, common::dense(7, 6));
    let mut random = Random(11);
    let (input, weights) = (random.values(42 * cin), random.values(9 * cin * cout));
    let dy = random.values(42 * cout);
    let loss = |input: &[f32]| -> f64 {
        let y = common::convolve(input, cin, &gather, &weights, cout);
        y.iter().zip(&dy).map(|(y, dy)| y * f64::from(*dy)).sum()
    };
    let slope = |at: usize| {
        let [mut low, mut high] = [input.clone(), input.clone()];
        (low[at], high[at]) = (input[at] - 0.125, input[at] + 0.125);
        (loss(&high) - loss(&low)) / f64::from(high[at] - low[at])
    };
    let expected: Vec<f64> = (0..input.len()).map(slope).collect();
    let transposed = Weights::pack_transposed(9, cin, cout, &weights);
    let dx = plainly(&dy, &gather.transposed(42), &transposed);
    assert_near(&dx, &expected, TOLERANCE, "gradient of the input");
}

#[test]
fn same_bits_with_any_number_of_threads() {
    fn check<I: Input>(cin: usize, cout: usize, taps: usize, absent_percent: usize) {
        let mut random = Random(5);
        let gather = random.gather(3001, taps, 2000, absent_percent);
        let input = I::inputs(&mut random, 2000 * cin);
        let plain = random.values(taps * cin * cout);
        let weights = Weights::pack(taps, cin, cout, &plain);
        let run = |threads| with_threads(threads, || plainly(&input, &gather, &weights));
        let one = run(1);
        assert!(one == run(2) && one == run(3));

        let (input, dy) = (random.values(2000 * cin), random.values(3001 * cout));
        let gradient = |threads| {
            let mut gradient = vec![0.0; taps * cin * cout];
            let level = Level::best();
            with_threads(threads, || {
                weight_gradient(level, &input, cin, &gather, &dy, cout, &mut gradient)
            });
            gradient
        };
        let one = gradient(1);
        assert!(one == gradient(2) && one == gradient(3));
    }
    for (cin, cout, taps, absent_percent) in [(48, 48, 9, 0), (16, 32, 27, 60), (96, 63, 1, 0)] {
        check::<f32>(cin, cout, taps, absent_percent);
        check::<Bf16>(cin, cout, taps, absent_percent);
        check::<u8>(cin, cout, taps, absent_percent);
        check::<i16>(cin, cout, taps, absent_percent);
    }
}

/// A row's bits depend neither on its position in a block nor on which other rows are computed.
#[test]
fn same_bits_for_a_part_of_the_rows() {
    let (cin, cout, taps) = (48, 96, 9);
    let mut random = Random(6);
    let gather = random.gather(500, taps, 400, 20);
    let input = random.values(400 * cin);
    let weights = Weights::pack(taps, cin, cout, &random.values(taps * cin * cout));
    let all = plainly(&input, &gather, &weights);
    let kept: Vec<usize> = (0..500).filter(|row| row % 7 < 3).collect();
    let index = kept.iter().flat_map(|row| &gather.index[row * taps..][..taps]);
    let some = Gather::new(taps, index.copied().collect());
    let some = plainly(&input, &some, &weights);
    for (row, some) in kept.iter().zip(some.chunks_exact(cout)) {
        assert!(some == &all[row * cout..(row + 1) * cout], "row {row}");
    }
}

/// Every level gives exact sums, even if they wrap on the way: processors with signed bytes add 128 times the weights.
#[test]
fn the_largest_sums_of_bytes_are_exact() {
    largest_sums::<u8>();
    largest_sums::<i16>();
}

fn largest_sums<I: Input>() {
    let (taps, cin, cout) = (9, 1024, 16);
    for (byte, weight) in [(255, 127.0), (255, -127.0), (0, 127.0)] {
        let case = Case::<I> {
            cin,
            cout,
            gather: Gather::new(taps, vec![0; 9 * 3]),
            input: vec![I::from_f32(byte as f32); cin],
            weights: vec![weight; taps * cin * cout],
            bias: None,
            relu: false,
        };
        for level in Level::all() {
            let output = case.run(level, None, vec![f32::NAN; 3 * cout]);
            let expected = (byte * weight as i32 * (taps * cin) as i32) as f32;
            assert!(output.iter().all(|y| *y == expected), "{}: {output:?}", level.name());
        }
    }
}

#[test]
fn weights_of_bytes_are_rounded_to_a_127th_of_their_channels_largest() {
    let (cin, cout) = (6, 5);
    let mut plain = Random(4).values(cin * cout);
    (0..cin).for_each(|i| plain[i * cout + 2] = 0.0);
    let weights = Weights::pack(1, cin, cout, &plain);
    assert_eq!(weights.scale()[2], 0.0, "a channel of zeros");
    for i in 0..cin {
        let mut input = vec![0_u8; cin];
        input[i] = 1;
        let output = plainly(&input, &Gather::new(1, vec![0]), &weights);
        for (o, (found, scale)) in output.iter().zip(weights.scale()).enumerate() {
            let error = (found - plain[i * cout + o]).abs();
            assert!(error <= 0.500_01 * scale, "{i} -> {o}: {error} of {scale}");
        }
    }
}

#[test]
fn nothing_to_do_changes_nothing() {
    for gather in [Gather::default(), Gather::new(9, vec![])] {
        let weights = Weights::pack(gather.taps, 4, 16, &vec![1.0; gather.taps * 64]);
        let (mut output, mut gradient) = (vec![3.0; 16], vec![3.0; gather.taps * 64]);
        let (input, epilogue) = ([1.0; 4], Epilogue::default());
        convolve(&input, &gather, &weights, epilogue, None, &mut output);
        weight_gradient(Level::best(), &input, 4, &gather, &[], 16, &mut gradient);
        assert!(output.iter().chain(&gradient).all(|&x| x == 3.0));
    }
}

/// A ReLU that turns NaN into a number would hide a broken model or input.
#[test]
fn not_a_number_stays_visible() {
    let weights = Weights::pack(1, 1, 16, &[1.0; 16]);
    let mut output = [0.0; 16];
    let gather = Gather::new(1, vec![0]);
    let (bias, relu) = (None, true);
    let epilogue = Epilogue { bias, relu };
    convolve(&[f32::NAN], &gather, &weights, epilogue, None, &mut output);
    assert!(output.iter().all(|y| y.is_nan()));
}

#[test]
fn a_row_outside_the_input_is_refused() {
    fn forward<I: Input>() {
        let gather = Gather::new(1, vec![0, 10, ABSENT]);
        let weights = Weights::pack(1, 4, 16, &[1.0; 64]);
        plainly(&[I::default(); 40], &gather, &weights);
    }
    fn gradient() {
        let (level, gather) = (Level::best(), Gather::new(1, vec![0, 10, ABSENT]));
        let (input, dy, sums) = (&[0.0; 40], &[0.0; 48], &mut [0.0; 64]);
        weight_gradient(level, input, 4, &gather, dy, 16, sums);
    }
    for read in [forward::<f32>, forward::<Bf16>, forward::<u8>, forward::<i16>, gradient] {
        assert_refused("input row 10 of 10", || with_threads(1, read));
    }
}

#[test]
fn output_rows_outside_or_in_another_order_are_refused() {
    let gather = Gather::new(1, vec![0, 1]);
    let weights = Weights::pack(1, 4, 16, &[1.0; 64]);
    for (rows, expected) in [([0, 2], "out of range"), ([1, 0], "rows that ascend")] {
        assert_refused(expected, || {
            let (input, output, epilogue) = ([0.0; 40], &mut [0.0; 32], Epilogue::default());
            convolve(&input, &gather, &weights, epilogue, Some(&rows), output);
        });
    }
}
