//! Convolution and its gradients against the plain version, on every set of registers of this machine.

mod common;

use common::{Random, assert_near, with_threads};
use mluc_kernels::{
    ABSENT, Bf16, Epilogue, Gather, Level, Weights, WeightsBf16, convolve, convolve_at,
    convolve_bf16, convolve_bf16_at, weight_gradient, weight_gradient_at,
};

const CHANNELS: [usize; 14] = [1, 3, 4, 16, 18, 31, 32, 48, 63, 64, 84, 96, 128, 256];
const ROWS: [usize; 9] = [1, 2, 5, 7, 13, 95, 96, 97, 301];
const TAPS: [usize; 4] = [1, 4, 9, 27];
const TOLERANCE: f64 = 2e-6;

struct Case {
    cin: usize,
    cout: usize,
    gather: Gather,
    input: Vec<f32>,
    weights: Vec<f32>,
    bias: Option<Vec<f32>>,
    relu: bool,
}

impl Case {
    fn random(seed: usize, cin: usize, cout: usize) -> Case {
        let mut random = Random(seed as u64);
        let (outputs, inputs) = (
            ROWS[random.below(ROWS.len())],
            ROWS[random.below(ROWS.len())],
        );
        // Large products are slow in the plain version; few taps show the same there.
        let taps = TAPS[random.below(if cin * cout > 4096 { 2 } else { 4 })];
        let absent_percent = [0, 0, 50, 90, 100][random.below(5)];
        let with_bias = random.below(2) == 0;
        Case {
            cin,
            cout,
            gather: random.gather(outputs, taps, inputs, absent_percent),
            input: random.values(inputs * cin),
            weights: random.values(taps * cin * cout),
            bias: with_bias.then(|| random.values(cout)),
            relu: random.below(2) == 0,
        }
    }

    fn epilogue(&self) -> Epilogue<'_> {
        Epilogue {
            bias: self.bias.as_deref(),
            relu: self.relu,
        }
    }

    fn expected(&self) -> Vec<f64> {
        let (input, weights, epilogue) = (&self.input, &self.weights, self.epilogue());
        common::convolve(input, self.cin, &self.gather, weights, self.cout, epilogue)
    }

    fn packed(&self) -> Weights {
        Weights::pack(self.gather.taps, self.cin, self.cout, &self.weights)
    }

    fn forward(&self, level: Level) -> Vec<f32> {
        let mut output = vec![f32::NAN; self.gather.outputs() * self.cout];
        let (weights, epilogue) = (self.packed(), self.epilogue());
        convolve_at(
            level,
            &self.input,
            &self.gather,
            &weights,
            epilogue,
            None,
            &mut output,
        );
        output
    }

    fn name(&self, level: Level) -> String {
        let Gather { taps, .. } = self.gather;
        let outputs = self.gather.outputs();
        format!(
            "{} {} -> {}, {taps} taps, {outputs} rows",
            level.name(),
            self.cin,
            self.cout
        )
    }
}

fn all_channels() -> impl Iterator<Item = Case> {
    let pairs = CHANNELS
        .iter()
        .flat_map(|&cin| CHANNELS.map(|cout| (cin, cout)));
    pairs
        .enumerate()
        .map(|(seed, (cin, cout))| Case::random(seed, cin, cout))
}

#[test]
fn forward_equals_plain() {
    for case in all_channels() {
        let expected = case.expected();
        for level in Level::all() {
            assert_near(
                &case.forward(level),
                &expected,
                TOLERANCE,
                &case.name(level),
            );
        }
    }
}

/// Against the plain version on the rounded values: products of bf16 are exact in f32, so only sums round.
#[test]
fn bf16_equals_plain() {
    for mut case in all_channels().filter(|case| case.cin % 2 == 0) {
        let input: Vec<Bf16> = case.input.iter().map(|&x| Bf16::from_f32(x)).collect();
        let weights = WeightsBf16::pack(case.gather.taps, case.cin, case.cout, &case.weights);
        let round = |values: &mut Vec<f32>| {
            values
                .iter_mut()
                .for_each(|x| *x = Bf16::from_f32(*x).to_f32())
        };
        round(&mut case.input);
        round(&mut case.weights);
        let expected = case.expected();
        for level in Level::all() {
            let (gather, epilogue) = (&case.gather, case.epilogue());
            let mut output = vec![f32::NAN; expected.len()];
            convolve_bf16_at(level, &input, gather, &weights, epilogue, None, &mut output);
            assert_near(&output, &expected, 2.0 * TOLERANCE, &case.name(level));
            let mut short = vec![Bf16::default(); expected.len()];
            convolve_bf16_at(level, &input, gather, &weights, epilogue, None, &mut short);
            assert!(
                short
                    .iter()
                    .zip(&output)
                    .all(|(short, &long)| *short == Bf16::from_f32(long))
            );
        }
    }
}

#[test]
fn output_rows_in_any_order() {
    for seed in 0..60 {
        let mut random = Random(seed);
        let case = Case::random(
            seed as usize,
            CHANNELS[random.below(14)],
            CHANNELS[random.below(14)],
        );
        let (outputs, cout, expected) = (case.gather.outputs(), case.cout, case.expected());
        let mut rows = random.permutation(2 * outputs);
        rows.truncate(outputs);
        if seed % 2 == 0 {
            rows.sort_unstable();
        }
        let mut output = vec![7.0; 2 * outputs * cout];
        convolve(
            &case.input,
            &case.gather,
            &case.packed(),
            case.epilogue(),
            Some(&rows),
            &mut output,
        );
        let named: Vec<f32> = rows
            .iter()
            .flat_map(|&row| output[row as usize * cout..][..cout].to_vec())
            .collect();
        assert_near(&named, &expected, TOLERANCE, "named rows");
        for row in (0..2 * outputs as u32).filter(|row| !rows.contains(row)) {
            assert!(
                output[row as usize * cout..][..cout]
                    .iter()
                    .all(|&y| y == 7.0),
                "row {row} is not named"
            );
        }
    }
}

#[test]
fn weight_gradient_equals_plain() {
    for case in all_channels() {
        let dy = Random(3).values(case.gather.outputs() * case.cout);
        let mut expected =
            common::weight_gradient(&case.input, case.cin, &case.gather, &dy, case.cout);
        expected.iter_mut().for_each(|g| *g += 0.25);
        for level in Level::all() {
            let mut gradient = vec![0.25; expected.len()];
            weight_gradient_at(
                level,
                &case.input,
                case.cin,
                &case.gather,
                &dy,
                case.cout,
                &mut gradient,
            );
            assert_near(&gradient, &expected, TOLERANCE, &case.name(level));
        }
    }
}

/// Without bias and ReLU, in the order of the rows.
fn plainly(input: &[f32], gather: &Gather, weights: &Weights, output: &mut [f32]) {
    convolve(input, gather, weights, Epilogue::NONE, None, output);
}

/// A map of `width x height` read by a 3x3 kernel; each (input row, tap) is read at most once.
fn dense(width: usize, height: usize) -> Gather {
    let mut index = Vec::new();
    for cell in 0..width * height {
        for tap in 0..9 {
            let (y, x) = (cell / width + tap / 3, cell % width + tap % 3);
            let inside = (1..=height).contains(&y) && (1..=width).contains(&x);
            index.push(if inside {
                ((y - 1) * width + x - 1) as u32
            } else {
                ABSENT
            });
        }
    }
    Gather::new(9, index)
}

/// The loss is `sum of y * dy`; its differences are taken in f64, where they are exact but for rounding.
#[test]
fn gradients_equal_finite_differences() {
    let (cin, cout, gather) = (5, 18, dense(7, 6));
    let mut random = Random(11);
    let (input, weights) = (random.values(42 * cin), random.values(9 * cin * cout));
    let dy = random.values(42 * cout);
    let loss = |input: &[f32], weights: &[f32]| -> f64 {
        let y = common::convolve(input, cin, &gather, weights, cout, Epilogue::NONE);
        y.iter().zip(&dy).map(|(y, dy)| y * f64::from(*dy)).sum()
    };
    let slope = |of: &[f32], at: usize, loss: &dyn Fn(&[f32]) -> f64| {
        let (mut low, mut high) = (of.to_vec(), of.to_vec());
        (low[at], high[at]) = (of[at] - 0.125, of[at] + 0.125);
        (loss(&high) - loss(&low)) / f64::from(high[at] - low[at])
    };

    let mut dx = vec![0.0; input.len()];
    let transposed = Weights::pack_transposed(9, cin, cout, &weights);
    plainly(&dy, &gather.transposed(42), &transposed, &mut dx);
    let expected: Vec<f64> = (0..dx.len())
        .map(|at| slope(&input, at, &|input| loss(input, &weights)))
        .collect();
    assert_near(&dx, &expected, TOLERANCE, "gradient of the input");

    let mut dw = vec![0.0; weights.len()];
    weight_gradient(&input, cin, &gather, &dy, cout, &mut dw);
    let expected: Vec<f64> = (0..dw.len())
        .map(|at| slope(&weights, at, &|weights| loss(&input, weights)))
        .collect();
    assert_near(&dw, &expected, TOLERANCE, "gradient of the weights");
}

#[test]
fn same_bits_with_any_number_of_threads() {
    for (cin, cout, taps, absent_percent) in [(48, 48, 9, 0), (16, 32, 27, 60), (96, 63, 1, 0)] {
        let mut random = Random(5);
        let gather = random.gather(3001, taps, 2000, absent_percent);
        let (input, dy) = (random.values(2000 * cin), random.values(3001 * cout));
        let input_bf16: Vec<Bf16> = input.iter().map(|&x| Bf16::from_f32(x)).collect();
        let plain = random.values(taps * cin * cout);
        let weights = Weights::pack(taps, cin, cout, &plain);
        let weights_bf16 = WeightsBf16::pack(taps, cin, cout, &plain);
        let epilogue = Epilogue::NONE;
        let work = || {
            let (mut y, mut y_bf16) = (vec![0.0; 3001 * cout], vec![Bf16(0); 3001 * cout]);
            let mut gradient = vec![0.0; taps * cin * cout];
            convolve(&input, &gather, &weights, epilogue, None, &mut y);
            convolve_bf16(
                &input_bf16,
                &gather,
                &weights_bf16,
                epilogue,
                None,
                &mut y_bf16,
            );
            weight_gradient(&input, cin, &gather, &dy, cout, &mut gradient);
            (y, y_bf16, gradient)
        };
        let run = |threads| with_threads(threads, work);
        let one = run(1);
        assert!(one == run(2), "1 and 2 threads");
        assert!(one == run(3), "1 and 3 threads");
    }
}

/// A row's bits depend neither on its place in a block nor on which other rows are computed.
#[test]
fn same_bits_for_a_part_of_the_rows() {
    let (cin, cout, taps) = (48, 96, 9);
    let mut random = Random(6);
    let gather = random.gather(500, taps, 400, 20);
    let input = random.values(400 * cin);
    let weights = Weights::pack(taps, cin, cout, &random.values(taps * cin * cout));
    let mut all = vec![0.0; 500 * cout];
    plainly(&input, &gather, &weights, &mut all);
    let kept: Vec<usize> = (0..500).filter(|row| row % 7 < 3).collect();
    let index = kept
        .iter()
        .flat_map(|row| gather.index[row * taps..(row + 1) * taps].to_vec())
        .collect();
    let mut some = vec![0.0; kept.len() * cout];
    plainly(&input, &Gather::new(taps, index), &weights, &mut some);
    for (row, some) in kept.iter().zip(some.chunks_exact(cout)) {
        assert!(some == &all[row * cout..(row + 1) * cout], "row {row}");
    }
}

#[test]
fn nothing_to_do_changes_nothing() {
    for gather in [Gather::default(), Gather::new(9, vec![])] {
        let weights = Weights::pack(gather.taps, 4, 16, &vec![1.0; gather.taps * 64]);
        let (mut output, mut gradient) = (vec![3.0; 16], vec![3.0; gather.taps * 64]);
        convolve(
            &[1.0; 4],
            &gather,
            &weights,
            Epilogue::NONE,
            None,
            &mut output,
        );
        weight_gradient(&[1.0; 4], 4, &gather, &[], 16, &mut gradient);
        assert!(output.iter().chain(&gradient).all(|&x| x == 3.0));
    }
}

#[test]
fn all_absent_leaves_the_bias() {
    let bias: Vec<f32> = (0..63).map(|x| x as f32 - 30.0).collect();
    let gather = Gather::new(9, vec![ABSENT; 9 * 200]);
    let mut output = vec![f32::NAN; 200 * 63];
    let weights = Weights::pack(9, 4, 63, &[1.0; 9 * 4 * 63]);
    convolve(
        &[],
        &gather,
        &weights,
        Epilogue {
            bias: Some(&bias),
            relu: true,
        },
        None,
        &mut output,
    );
    let expected = |row: &[f32]| row.iter().zip(&bias).all(|(y, b)| *y == b.max(0.0));
    assert!(output.chunks_exact(63).all(expected));
}

/// A ReLU that swallows NaN would hide a broken model or input.
#[test]
fn not_a_number_stays_visible() {
    let weights = Weights::pack(1, 1, 16, &[1.0; 16]);
    let mut output = [0.0; 16];
    let gather = Gather::new(1, vec![0]);
    let epilogue = Epilogue::RELU;
    convolve(&[f32::NAN], &gather, &weights, epilogue, None, &mut output);
    assert!(output.iter().all(|y| y.is_nan()));
}

#[test]
#[should_panic(expected = "input row 10 of 10")]
fn forward_refuses_a_row_outside_the_input() {
    let gather = Gather::new(1, vec![0, 10, ABSENT]);
    let weights = Weights::pack(1, 4, 16, &[1.0; 64]);
    with_threads(1, || {
        convolve(
            &[0.0; 40],
            &gather,
            &weights,
            Epilogue::NONE,
            None,
            &mut [0.0; 48],
        )
    });
}

#[test]
#[should_panic(expected = "input row 10 of 10")]
fn weight_gradient_refuses_a_row_outside_the_input() {
    let gather = Gather::new(1, vec![0, 10, ABSENT]);
    with_threads(1, || {
        weight_gradient(&[0.0; 40], 4, &gather, &[0.0; 48], 16, &mut [0.0; 64])
    });
}

#[test]
#[should_panic]
fn forward_refuses_an_output_row_outside() {
    let gather = Gather::new(1, vec![0, 1]);
    let weights = Weights::pack(1, 4, 16, &[1.0; 64]);
    let output = &mut [0.0; 32];
    convolve(
        &[0.0; 40],
        &gather,
        &weights,
        Epilogue::NONE,
        Some(&[0, 2]),
        output,
    );
}
